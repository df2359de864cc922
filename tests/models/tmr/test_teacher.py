"""Motions and sentences in one space: the contrast, N devices, and what is found with a trained teacher."""
import json
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import export, retrieval
from motion_jax import fit as training
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.humanml3d import write_folder
from motion_jax.data.datasets.registry import dataset_of
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models import tmr
from motion_jax.training.metrics import read_metrics
from motion_jax.training.optimizers import make_optimizer
from motion_studio import cli
from tests import processes
from tests.conftest import brief_run, devices_env, load_config, some_of


def test_contrast_of_orthogonal_pairs():
  """Right pairs at cosine 1, all others at 0: log(1 + (B - 1) e^-scale) both ways."""
  value, logits = tmr.info_nce(jnp.eye(4), jnp.eye(4), 2.0)
  assert np.isclose(value, np.log(1 + 3 * np.exp(-2.0)), atol=1e-6)
  assert np.allclose(logits, 2 * np.eye(4))


def test_the_same_words_are_no_counter_example():
  text = jnp.eye(4)[jnp.array([0, 0, 1, 2])]
  same = (text @ text.T) > 0.5
  counted, _ = tmr.info_nce(text, text, 20.0)
  skipped, _ = tmr.info_nce(text, text, 20.0, same)
  assert counted > 0.3 and skipped < 1e-6


def test_rates_hold_parameters_still_or_slow_them():
  config = load_config("part_tmr", "full").optimizer
  tx = make_optimizer(config, 100)
  params = {"motion": {"logit_scale": jnp.ones(()), "w": jnp.ones(2)}, "text": {"w": jnp.ones(2)}}
  updates, _ = tx.update(jax.tree.map(jnp.ones_like, params), tx.init(params), params)
  assert updates["motion"]["logit_scale"] == 0
  assert np.allclose(updates["text"]["w"], 0.1 * updates["motion"]["w"]) and updates["motion"]["w"][0] < 0


def losses(folder, name, num_devices):
  """Loss and gradient of the two steps of a tiny config; `light_setups` are at work."""
  assert jax.local_device_count() == num_devices
  config = load_config(name, "tiny").unlock()
  config.model.dropout = 0.0
  if name == "part_tmr":
    config.model.update(kind="whole_body", head_dropout=0.0)  # one part compiles faster than six
  training.run(config, folder)
  return [(row["loss"], row["grad_norm"]) for row in read_metrics(folder) if "loss" in row]


_DEVICES = """
import json, sys
from tests import conftest
from tests.models.tmr import test_teacher
known = conftest.light_setups()
conftest.training.setups = lambda: known
print(json.dumps(test_teacher.losses(sys.argv[1], sys.argv[2], 2)))
"""


@pytest.mark.parametrize("name", some_of(["part_tmr", "tmr"], slow=["part_tmr"]))
def test_two_devices_contrast_the_whole_batch(tmp_path, name, unjudged):
  """In training, on devices (`test_matching` has losses alone): each sentence meets the motions of the other device too
  (dropout off: its masks fall on other rows), and a TMR's noise is that of a pair's place in the whole batch.

  Losses and gradients are compared: Adam's first step makes a whole step of a gradient that is rounding alone.
  """
  done = processes.run(["-c", _DEVICES, tmp_path / "two", name], devices_env(2))
  assert done.returncode == 0, done.stderr[-2000:]
  one, two = losses(tmp_path / "one", name, 1), json.loads(done.stdout.splitlines()[-1])
  assert len(one) == 2 and np.allclose(one, two, rtol=1e-3)


@pytest.fixture(scope="module")
def run_and_data(tmp_path_factory):
  folder = tmp_path_factory.mktemp("teacher")
  brief_run("part_tmr", folder / "run", num_steps=1, kind="whole_body")  # one part compiles faster than six
  write_folder(synthetic_clips(0, 8), folder / "data", mirror=False)
  return folder / "run", folder / "data"


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_vectors_are_of_unit_length_and_know_no_batch_mates(run_and_data):
  retriever = retrieval.load(run_and_data[0])
  features = [retriever.features_of(clip) for clip in synthetic_clips(0, 3)]
  together = retriever.embed_motion(features)
  assert np.allclose(np.linalg.norm(together, axis=-1), 1, atol=1e-5)
  assert np.allclose(retriever.embed_motion(features[1:2])[0], together[1], atol=1e-5)
  text = retriever.embed_text(["a person walks", "a person jumps up and down again and again"])
  assert np.allclose(retriever.embed_text(["a person walks"])[0], text[0], atol=1e-5)


def test_a_long_motion_is_the_mean_of_its_pieces(run_and_data):
  retriever = retrieval.load(run_and_data[0])
  x = np.concatenate([retriever.features_of(clip) for clip in synthetic_clips(0, 3)])[:128]
  halves = retriever.embed_motion([x[:64], x[64:]]).sum(0)
  assert np.allclose(retriever.embed_motion([x])[0], halves / np.linalg.norm(halves), atol=1e-5)


def test_retrieve_from_the_command_line(run_and_data, tmp_path, capsys):
  run, data = map(str, run_and_data)
  ask = lambda *words: cli.main(["retrieve", *words, "--data", data, "--teacher", run])
  out = tmp_path / "nearest.npz"
  assert ask("a person walks", "--top-k", "3", "--out", str(out)) == 0
  lines = capsys.readouterr().out.splitlines()
  cosines = [float(line.split()[0]) for line in lines[1:4]]
  assert "8 clips" in lines[0] and cosines == sorted(cosines, reverse=True)
  nearest = export.load(out)
  assert nearest.id == lines[1].split()[1] or nearest.num_frames > 8
  index, = (tmp_path / "cache" / "motion_jax" / "indices").iterdir()
  assert ask(str(out)) == 0  # the other way: a motion in, captions out
  assert len(capsys.readouterr().out.splitlines()) >= 3
  assert ask() == 0
  recall = capsys.readouterr().out
  assert "text to motion: at 1 " in recall

  # From the index nothing is read or embedded again; a damaged one is made anew, to the same bytes.
  whole = index.read_bytes()
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(retrieval, "read_clips", None)
    assert ask() == 0
    assert capsys.readouterr().out == recall
  index.write_bytes(whole[:-5] + b"trash")
  assert ask() == 0
  assert capsys.readouterr().out == recall and index.read_bytes() == whole


def test_the_index_belongs_to_data_teacher_and_split(run_and_data, tmp_path):
  data = shutil.copytree(run_and_data[1], tmp_path / "data")
  before = dataset_of(data).fingerprint(data)
  assert dataset_of(data).fingerprint(data) == before
  text = next((data / "texts").glob("*.txt"))
  text.write_text(text.read_text().replace("person", "robot"))
  assert dataset_of(data).fingerprint(data) != before
  run = shutil.copytree(run_and_data[0], tmp_path / "run")
  one = retrieval.load(run).fingerprint
  mean = np.load(run / "Mean.npy")
  np.save(run / "Mean.npy", mean + 1)
  assert retrieval.load(run).fingerprint != one


def test_mistakes_are_told(run_and_data, tmp_path, capsys, tiny_run):
  run, data = map(str, run_and_data)
  for words, told in (
      (["a", "--data", str(tmp_path), "--teacher", run], "is no data folder"),
      (["a", "--data", data, "--teacher", str(tmp_path / "none")], "neither a run folder"),
      (["a", "--data", data, "--teacher", str(tiny_run)], "tmr.teacher"),
      ([" ", "--data", data, "--teacher", run], "empty sentence"),
      (["none.npz", "--data", data, "--teacher", run], "none.npz"),
  ):
    assert cli.main(["retrieve", *words]) == 1
    assert told in capsys.readouterr().err
  with pytest.raises(SystemExit):
    cli.main(["retrieve", "a", "--top-k", "0", "--data", data, "--teacher", run])
  assert "--top-k: got '0', expected a whole number from 1 to 10,000" in capsys.readouterr().err


def test_clips_without_captions_are_told(tmp_path):
  clip = synthetic_clips(0, 1)[0]
  write_folder([Clip(clip.joints, captions=clip.captions, id="a", split="train")], tmp_path / "data", mirror=False)
  with pytest.raises(ValueError, match="no clip with a caption in split 'test'"):
    retrieval.read_clips(tmp_path / "data", "test")


def test_contrast_counts_both_ways():
  """Rows that find their columns and columns that find their rows are not the same where logits are not symmetric."""
  logits = np.array([[2.0, 0, 1], [5, 1, 0], [4, 2, 2]])
  ways = [-np.mean(np.diag(a) - np.log(np.exp(a).sum(1))) for a in (logits, logits.T)]
  assert abs(ways[0] - ways[1]) > 0.1
  np.testing.assert_allclose(tmr.symmetric_cross_entropy(jnp.asarray(logits)), np.mean(ways), rtol=1e-5)
