"""Motions that another program made are read from its files; see test_run.py for how they are judged."""
import types

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation import external
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.motion.representations import get_layout, to_joints


@pytest.fixture(scope="module")
def evaluator():
  return fresh_evaluator("t2m")


def test_joints_may_lie_anywhere(tmp_path, evaluator):
  layout, joints = get_layout("coordinates"), synthetic_clips(num=2, num_frames=20)[1].joints + np.float32(0.5)
  turned = joints[..., [2, 1, 0]] * [1, 1, -1] + [3, 0, -2]
  read = []
  for name, x in (("a", joints), ("b", turned)):
    (tmp_path / name / "r000").mkdir(parents=True)
    np.save(tmp_path / name / "r000" / "00000.npy", x)
    candidate = external.load_external(name, tmp_path / name, evaluator)
    read.append(candidate.sample(None, None, "r000", types.SimpleNamespace(frames=[12]), "")[0])
  assert read[0].shape == (16, 66) and np.abs(read[0] - read[1]).max() < 1e-5
  root = to_joints(read[0], layout)[0, 0]
  assert np.abs(root[[0, 2]]).max() < 1e-6 and root[1] == pytest.approx(joints[0, 0, 1])


@pytest.mark.parametrize("x, words", [
    (np.zeros((8, 66)), "got 8 frames, 12 were asked for"), (np.full((12, 66), np.nan), "holds NaN"),
    (np.zeros((12, 5)), r"got an array of shape \(12, 5\), expected \(frames, 66\) as in the first file, or joints"),
])
def test_what_cannot_be_judged_is_told(tmp_path, evaluator, x, words):
  with pytest.raises(FileNotFoundError, match="holds no motions: expected files such as r000/00000.npy"):
    external.load_external("a", tmp_path, evaluator)
  (tmp_path / "r000").mkdir()
  np.save(tmp_path / "r000" / "00000.npy", np.zeros((12, 66)))
  np.save(tmp_path / "r000" / "00001.npy", x)
  candidate = external.load_external("a", tmp_path, evaluator)
  with pytest.raises(ValueError, match=words):
    candidate.sample(None, None, "r000", types.SimpleNamespace(frames=[12, 12]), "")


def test_joints_of_another_unit_are_refused(tmp_path, evaluator):
  joints = synthetic_clips(num=2, num_frames=20)[1].joints
  (tmp_path / "r000").mkdir()
  np.save(tmp_path / "r000" / "00000.npy", joints * 100)
  candidate = external.load_external("a", tmp_path, evaluator)
  with pytest.raises(ValueError, match="00000.npy: bones are .* times as long .* in centimetres"):
    candidate.sample(None, None, "r000", types.SimpleNamespace(frames=[12]), "")
