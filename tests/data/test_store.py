"""A store gives training what the frozen encoders would have given, and is refused where they are others."""
import pickle

import jax
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data.batches import TextItems
from motion_jax.data.store import Store, digest_of, stored_batch, writing
from motion_jax.text.captions import SUBJECTS, vary_subject, with_subjects
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics
from motion_jax.training.setup import untrained
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests.conftest import load_config


def _write(folder, entries, identity=None):
  with writing(folder) as writer:
    for rows in entries.values():
      writer.add("latents", rows)
    writer.close(identity or {"data": "a"}, list(entries), [])
  return folder


def test_rows_come_back(tmp_path):
  draw = np.random.default_rng(0)
  entries = {(3, 0, 8): draw.normal(size=(2, 5)), (3, 0, 12): draw.normal(size=(3, 5)), (7, 2, 4): np.ones((1, 5))}
  store = Store(_write(tmp_path / "store", entries))
  for (clip, start, count), rows in entries.items():
    np.testing.assert_array_equal(store.cut("latents", clip, start, count), rows)
  np.testing.assert_array_equal(store.cut("latents", 3, 0), entries[3, 0, 12])  # the longest
  with pytest.raises(InputError, match="no latents of clip 3 from frame 1 of 8 frames"):
    store.cut("latents", 3, 1, 8)


def test_another_process_opens_the_store_itself(tmp_path):
  entries = {(0, 0, 400): np.random.default_rng(0).normal(size=(100, 64))}
  handed_on = pickle.dumps(Store(_write(tmp_path / "store", entries)))
  assert len(handed_on) < 1000
  np.testing.assert_array_equal(pickle.loads(handed_on).cut("latents", 0, 0), entries[0, 0, 400])


def test_a_store_is_whole_or_not_there_and_its_damage_is_told(tmp_path):
  with pytest.raises(KeyboardInterrupt), writing(tmp_path / "cut") as writer:
    writer.add("latents", np.ones((2, 3)))
    raise KeyboardInterrupt
  assert not list(tmp_path.iterdir())
  folder = _write(tmp_path / "store", {(0, 0, 4): np.ones((1, 3), np.float32)})
  with pytest.raises(InputError, match="is there already"), writing(folder):
    pass
  Store(folder).require({"data": "a"})
  for other in ({"data": "b"}, {}, {"data": "a", "rules": "c"}):
    with pytest.raises(InputError, match="was made from other (data|rules) than this run has"):
      Store(folder).require(other)
  rows = folder / "latents.rows"
  content = bytearray(rows.read_bytes())
  content[3] ^= 1
  rows.write_bytes(content)
  assert Store(folder).damage() == ["latents"]
  rows.write_bytes(content[:-1])
  with pytest.raises(InputError, match="cut short: expected 1 rows of 3 float32; make the store again"):
    Store(folder)
  with pytest.raises(FileNotFoundError, match="it is no store"):
    Store(tmp_path)


@pytest.mark.parametrize("options", [{}, {"shorten_rate": 1.0}, {"crop_frames": 48, "keep_long": True}])
def test_every_cut_that_is_drawn_is_among_the_cuts(options):
  clips = [np.zeros((n, 1), np.float32) for n in (40, 77, 199, 120)]
  items = TextItems(clips, [["a"]] * 4, lengths=(96, 192), **options)
  cuts, seen = set(items.cuts()), set()
  for step in range(400):
    drawn = items.draw(4, 0, step)
    seen |= {(*cut, drawn.length) for cut in zip(*map(np.ndarray.tolist, (drawn.clip, drawn.start, drawn.num_frames)))}
  assert seen <= cuts and len(seen) > 0.5 * len(cuts)


def test_digests_know_names_shapes_and_numbers():
  trees = [{"a": np.zeros(4)}, {"b": np.zeros(4)}, {"a": np.zeros((2, 2))}, {"a": np.ones(4)}, {"a": np.zeros(4, "f4")}]
  assert len({digest_of(tree) for tree in trees} | {digest_of("a"), digest_of("a", "b"), digest_of("ab")}) == 8
  assert digest_of({"a": np.zeros(4)}) == digest_of(trees[0])


def test_captions_are_kept_with_all_subjects():
  kept = with_subjects("a person walks.")
  said = {vary_subject("a person walks.", np.random.default_rng(i), 0.9) for i in range(200)}
  assert said == set(kept) and len(set(kept)) == len(SUBJECTS)
  assert with_subjects("walks.") == ["walks."]


def _small(name):
  config = load_config(name, "tiny")
  with config.unlocked():
    config.data.update(num_clips=3, vary_subject=0.5)
  return config


@pytest.mark.slow
def test_a_stage_learns_the_same_from_a_store(tmp_path):
  config = _small("cmdm_denoiser").unlock()
  told = fit.encode(config, tmp_path / "store")
  assert "cuts of" in told and "captions" in told
  resolved = fit.resolve(config)[0]
  plain = fit.setups()[config.stage](resolved)
  with resolved.unlocked():
    resolved.data.store = str(tmp_path / "store")
  stored = fit.setups()[config.stage](resolved)
  shapes = jax.eval_shape(plain.stage.init, plain.next_batch(0), jax.random.key(0))
  # Weights of which none is zero, as those of a network's last layer are in the beginning.
  params = jax.tree.map(lambda x: x + 0.05 * np.random.default_rng(x.size).normal(size=x.shape).astype(x.dtype),
                        untrained(shapes))
  losses = [jax.jit(setup.stage.loss) for setup in (plain, stored)]
  for step in (0, 1, 2):
    batches = [setup.next_batch(step) for setup in (plain, stored)]
    assert "features" not in batches[1]
    np.testing.assert_allclose(batches[1]["text_emb"], batches[0]["text_emb"], atol=1e-5)
    made = [loss(params, setup.frozen, batch, step, jax.random.key(step))
            for loss, setup, batch in zip(losses, (plain, stored), batches)]
    for a, b in zip(*map(jax.tree.leaves, made)):
      np.testing.assert_allclose(b, a, rtol=2e-4)


@pytest.mark.slow
def test_a_store_of_other_parts_is_refused_by_name(tmp_path):
  config = _small("cmdm_denoiser")
  fit.encode(config, tmp_path / "store")
  with config.unlocked():
    config.data.update(store=str(tmp_path / "store"), num_clips=2)
  with pytest.raises(InputError, match="was made from other data, rules of cutting than this run has"):
    fit.setups()[config.stage](fit.resolve(config)[0])
  with config.unlocked():
    config.data.num_clips, config.tokenizer.width = 3, 8
  with pytest.raises(InputError, match="was made from other tokenizer than"):
    fit.setups()[config.stage](fit.resolve(config)[0])
  with pytest.raises(ValueError, match="trains on no latents; expected one of cmdm.denoiser"):
    fit.encode(load_config("cdamd_rvq", "tiny"), tmp_path / "other")


@pytest.mark.slow
def test_at_the_command_line(tmp_path, capsys):
  store, run = str(tmp_path / "store"), str(tmp_path / "run")
  asked = ["--config", "cmdm_denoiser:tiny"]
  assert not cli.main(["data", "encode", *asked, "--out", store])
  assert "train on it: motion-jax train --config cmdm_denoiser:tiny" in capsys.readouterr().out
  assert not cli.main(["data", "doctor", store]) and "whole" in capsys.readouterr().out
  assert not cli.main(["train", *asked, f"--config.data.store={store}", "--workdir", run])
  rows = read_metrics(run)
  assert np.isfinite([row["loss"] for row in rows if "seconds" in row]).all() and "held_out_loss" in rows[-1]
  assert checkpoint.load_config(run).data.store == store


def test_a_shorter_cut_has_the_first_latents_of_the_longest(tmp_path):
  clips = [np.zeros((44, 1), np.float32)]
  items = TextItems(clips, [["a"]], lengths=(48,), max_frames=48)
  rows = np.arange(11.0)[:, None]
  store = Store(_write(tmp_path / "store", {(0, start, 44 - start): rows[:(44 - start) // 4] for start in range(5)}))
  shorter = 0
  for step in range(100):
    batch = stored_batch(store, items, ("latents",), 1, 0, step, latents_look_back=True)
    count = batch["num_frames"][0] // 4
    shorter += count < len(store.cut("latents", 0, int(items.draw(1, 0, step).start[0])))
    assert batch["latents"].shape == (1, 12, 1)
    np.testing.assert_array_equal(batch["latents"][0, :, 0], np.arange(12) * (np.arange(12) < count))
  assert shorter


def test_a_part_of_a_batch_is_those_rows_of_it(tmp_path):
  """As each of several processes makes its own; it reads no cut of the others."""
  items = TextItems([np.zeros((44, 1), np.float32)] * 3, [["a"]] * 3, lengths=(48,), max_frames=48)
  draw = np.random.default_rng(0)
  store = Store(_write(tmp_path / "store", {(clip, start, count): draw.normal(size=(count // 4, 2))
                                           for clip, start, count, _ in items.cuts()}))
  cut, read = store.cut, []
  store.cut = lambda *key: (read.append(key), cut(*key))[1]
  for look_back in (False, True):
    whole = stored_batch(store, items, ("latents",), 3, 0, 5, latents_look_back=look_back)
    read.clear()
    part = stored_batch(store, items, ("latents",), 3, 0, 5, slice(1, 3), latents_look_back=look_back)
    assert len(read) == 2
    for name in ("latents", "num_frames", "index"):
      np.testing.assert_array_equal(part[name], whole[name][1:3])
