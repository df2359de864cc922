"""What is judged: draws of a split, its hash, clips that are left out, and whose samples are on disk."""
import dataclasses
import itertools
import types

import numpy as np
import pytest

from motion_jax.evaluation import samples
from motion_jax.evaluation import test_set as test_set_lib
from motion_jax.evaluators.evaluator import fresh_evaluator
from tests.evaluation.small import SMALL, make_clips, write_archive


def test_a_draw_follows_the_rules_of_items(archive, evaluators):
  test_set = test_set_lib.read_test_set([archive], SMALL, list(evaluators.values()))
  drawn = samples.draw_replication(test_set, SMALL, 0, 0)
  assert len(drawn) == 8 and len(set(drawn.item)) == 8
  assert set(drawn.frames) == {44, 48}  # rows 48: whole units, one less where the coin says so
  features = test_set.of(evaluators["evaluator"])
  for x, i, start, count in zip(drawn.cut(features), drawn.item, drawn.start, drawn.frames):
    np.testing.assert_array_equal(x, features[i][start:start + count])
  same, other = samples.draw_replication(test_set, SMALL, 0, 0), samples.draw_replication(test_set, SMALL, 0, 1)
  assert all((a == b).all() for a, b in zip(drawn, same)) and (drawn.item != other.item).any()
  words = [len(caption.split()) for caption in drawn.captions_of(test_set)]
  assert all(words[i:i + 4] == sorted(words[i:i + 4], reverse=True) for i in (0, 4))
  plain = dataclasses.replace(SMALL, coin=False, random_crop=False, random_caption=False, shuffle=False)
  drawn = samples.draw_replication(test_set, plain, 0, 0, limit=5)
  assert len(drawn) == 4 and (drawn.start == 0).all() and (drawn.frames == 48).all() and (drawn.caption == 0).all()
  short = samples.draw_replication(test_set, dataclasses.replace(SMALL, max_frames=20), 0, 0)
  assert (short.frames == 20).all() and short.start.max() > 4


def test_draws_are_spread_as_the_loaders_spread_them():
  """One time in three a unit less; a cut begins anywhere that it fits; each copy of an item has noise of its own."""
  count = 3000
  test_set = types.SimpleNamespace(rows=np.full(count, 50), captions=[("a", "b")] * count, tokens=[(None,) * 2] * count)
  drawn = samples.draw_replication(test_set, SMALL, 0, 0)
  shorter = drawn.frames == 44
  assert np.isclose(shorter.mean(), 1 / 3, atol=0.03) and set(drawn.frames[~shorter]) == {48}
  assert set(drawn.start[shorter]) == set(range(7)) and set(drawn.start[~shorter]) == set(range(3))
  assert np.isclose(drawn.caption.mean(), 0.5, atol=0.03)
  assert len({samples.seed_of(*numbers) for numbers in itertools.product(range(2), repeat=4)}) == 16


def test_clips_of_test_in_train(tmp_path, evaluators):
  clips = make_clips(6)
  copied = write_archive(tmp_path / "copied", clips + [clips[-1].replace(id="other", split="train")])
  with pytest.raises(ValueError, match="1 clips of split 'test' are in train, too, such as 000005"):
    test_set_lib.read_test_set([copied], SMALL, list(evaluators.values()))
  test_set = test_set_lib.read_test_set([copied], SMALL, list(evaluators.values()), allow_shared=True)
  assert test_set.shared == ["000005"] and "000005" in test_set.ids


@pytest.mark.slow
def test_the_split_is_the_same_whoever_judges_it(archive, evaluators, tmp_path):
  """Its hash is of what is stored: other evaluators leave it, another motion or caption does not."""
  read = lambda folder, *readers: test_set_lib.read_test_set([folder], SMALL, readers).hash
  first = read(archive, evaluators["evaluator"])
  assert first == read(archive, fresh_evaluator("clip"), fresh_evaluator("t2m", "full"))
  clips = make_clips()
  other = clips[:-1] + [clips[-1].replace(joints=clips[-1].joints * np.float32(1.001))]
  assert first != read(write_archive(tmp_path / "a" / archive.name, other), evaluators["evaluator"])
  said = clips[:-1] + [clips[-1].replace(captions=clips[0].captions)]
  assert first != read(write_archive(tmp_path / "b" / archive.name, said), evaluators["evaluator"])
  assert first == read(write_archive(tmp_path / "c" / archive.name, clips), evaluators["evaluator"])


def test_samples_know_all_code_that_made_them(tmp_path):
  jobs = samples.Jobs(["a"], [4], [1], [0])
  for commit in ("old", "old", "new"):
    samples.Store(tmp_path, dict(a=1), dict(code=commit)).write(f"r{commit}", 0, jobs, [np.zeros((4, 2))])
  store = samples.Store(tmp_path, dict(a=1), dict(code="newest"))
  assert store.makers == [dict(code="old"), dict(code="new")] and store.read("rold", 0, jobs) is not None
  assert store.read("rold", 0, jobs._replace(seeds=[2])) is store.read("rold", 0, jobs._replace(frames=[3])) is None
  assert samples.Store(tmp_path, dict(a=2)).makers == []


def test_clips_with_nan_are_named_and_left_out(tmp_path, evaluators):
  clips = make_clips(6)
  folder = write_archive(tmp_path / "archive", clips)
  with np.load(folder / "motions.npz") as file:
    arrays = {name: file[name].copy() for name in file.files}
  arrays["root"][arrays["start"][4] + 3] = np.nan
  np.savez(folder / "motions.npz", **arrays)
  test_set = test_set_lib.read_test_set([folder], SMALL, list(evaluators.values()))
  assert test_set.excluded == [("000004", "NaN")] and test_set.ids == ["000002", "000003", "000005"]
