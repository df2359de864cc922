"""The long-horizon scores have the values that closed forms give."""
import dataclasses

import numpy as np
import pytest

from motion_jax.metrics import long_horizon as lh
from motion_jax.metrics import physics
from tests.metrics.test_physics import still

SMALL = lh.LongHorizon(width=12, shortest=8, longest=40, pool=4)


def _joints(frames, cubic=0.0):
  """A standing body (frames, 22, 3) that moves along x by cubic * t**3."""
  return still(frames) + cubic * np.arange(frames)[:, None, None] ** 3 * [1.0, 0, 0]


def _sequence(rng, captions, text, frames=13, cubic=0.0, motion=None):
  total = frames * len(captions)
  motion = rng.normal(size=(total, 3)) if motion is None else motion
  return lh.Sequence(motion, _joints(total, cubic), (frames,) * len(captions), tuple(captions), text)


def _mean(motions):
  return np.stack([np.mean(motion, axis=0) for motion in motions])


def _real(rng, num=40, cubic=0.0, protocol=SMALL):
  motions = [rng.normal(size=(int(n), 3)) for n in rng.integers(8, 41, num)]
  return motions, [_joints(len(motion), cubic) for motion in motions]


def test_pieces_are_cut_at_the_borders():
  assert lh.whole_units([13, 16, 7], SMALL) == [12, 16, 4]
  pieces = lh.cut_pieces(np.arange(40), [12, 16, 4])
  assert [(piece[0], len(piece)) for piece in pieces] == [(0, 12), (12, 16), (28, 4)]
  with pytest.raises(ValueError, match="motion of 20 frames and pieces of 32"):
    lh.cut_pieces(np.arange(20), [12, 16, 4])


def test_a_perfect_sequence_scores_all_and_merged_captions_are_scaled_up():
  text = np.eye(5)
  text[3] = text[1]
  captions = ["a", "b", "c", "b", "d"]
  np.testing.assert_allclose(lh.caption_hits(text, text, captions), [5, 5, 5])
  # Unmerged, the twins share first and second place.
  np.testing.assert_allclose(lh.caption_hits(text, text, captions, merge=False), [4, 5, 5])
  # By angle, as SnapMoGen ranks, a motion twice as far out is as near to its words.
  far = text[:3] * [[9.0], [0.1], [5.0]]
  assert lh.caption_hits(text[:3], far, captions[:3], 1, cosine=True).tolist() == [3]
  assert lh.caption_hits(text[:3], far, captions[:3], 1).tolist() != [3]
  wrong = text[[1, 0, 2, 3, 4]]  # a and b for each other; the twin, whose motion fits, is left out
  np.testing.assert_allclose(lh.caption_hits(text, wrong, captions, 1), [2 * 5 / 4])


def test_the_way_a_body_walks_does_not_change_its_jerk():
  """Jerk is summed over x, y and z; transitions are turned to face +z first, as joints of their features alone do."""
  rng = np.random.default_rng(2)
  real = lh.reference(*_real(rng), _mean, rng, SMALL)
  one = _sequence(rng, "abc", rng.normal(size=(3, 3)), cubic=1e-4)
  turn = np.array([[1, 0, -1], [0, np.sqrt(2), 0], [1, 0, 1]]) / np.sqrt(2)
  turned = one._replace(joints=one.joints @ turn.T)
  jerks = lambda protocol: [lh.score([x], real, _mean, rng, protocol).curve for x in (one, turned)]
  straight, oblique = jerks(SMALL)
  np.testing.assert_allclose(oblique, straight, rtol=1e-6)
  straight, oblique = jerks(dataclasses.replace(SMALL, placed=False))
  np.testing.assert_allclose(oblique, np.sqrt(2) * straight, rtol=1e-6)


def test_jerk_of_a_cubic():
  rng = np.random.default_rng(1)
  motions, joints = _real(rng)
  real = lh.reference(motions, joints, _mean, rng, SMALL)
  assert real.level == physics.REAL_JERK["humanml3d"] and real.curve.shape == (9,)
  row, curve = lh.score([_sequence(rng, "abcd", rng.normal(size=(4, 3)), cubic=1e-4)], real, _mean, rng, SMALL)
  np.testing.assert_allclose(curve, 6e-4, rtol=1e-6)
  assert row["peak_jerk"] == pytest.approx(6e-4) and row["auj"] == pytest.approx(9 * (0.033031363 - 6e-4))
  assert row["transition_distance"] == pytest.approx(0, abs=1e-12)
  # The level of the real crops themselves, here of another cubic.
  own = dataclasses.replace(SMALL, real_jerk=None)
  real = lh.reference(motions, [_joints(len(one), 2e-5) for one in motions], _mean, rng, own)
  row, _ = lh.score([_sequence(rng, "abcd", rng.normal(size=(4, 3)), cubic=1e-4)], real, _mean, rng, own)
  assert row["auj"] == pytest.approx(9 * (6e-4 - 1.2e-4), rel=1e-6)


def test_fid_of_gaussians_and_matching_through_the_whole_path():
  """Pieces are constant in time, so `embed` gives their draw back: N(0, 1) against N(shift, spread)."""
  rng = np.random.default_rng(2)
  shift, spread = np.array([0.5, 0.0, -1.0]), np.array([1.0, 2.0, 0.5])
  constant = lambda draws, frames: np.repeat(draws, frames, axis=0)
  draws = rng.normal(size=(2000, 3))
  motions = [constant(draw[None], 12) for draw in draws]
  protocol = dataclasses.replace(SMALL, diversity_draws=2000, placed=False)  # bodies that stand are placed as they are
  real = lh.reference(motions, [_joints(12)] * len(motions), _mean, rng, protocol)
  sequences, offset = [], np.array([3.0, 4.0, 0.0])
  for _ in range(125):
    made = shift + spread * rng.normal(size=(16, 3))
    sequences.append(_sequence(rng, [str(i) for i in range(16)], made + offset, 12, motion=constant(made, 12)))
  row, _ = lh.score(iter(sequences), real, _mean, rng, protocol)
  expected = (shift**2).sum() + ((spread - 1) ** 2).sum()  # 1.25 + 1.25
  assert row["fid"] == pytest.approx(expected, rel=0.08)
  assert row["matching"] == pytest.approx(5)
  # |a - b| of two draws, E over N(0, 2 spread**2)
  distance = np.linalg.norm(np.sqrt(2) * spread * rng.normal(size=(200_000, 3)), axis=1).mean()
  assert row["diversity"] == pytest.approx(distance, rel=0.05)
  # A transition of two constant halves is their mean, with half the variance.
  expected = (shift**2).sum() + ((spread / np.sqrt(2) - 1) ** 2).sum()
  assert row["transition_fid"] == pytest.approx(expected, rel=0.08)


def test_bad_input():
  rng = np.random.default_rng(5)
  motions, joints = _real(rng)
  real = lh.reference(motions, joints, _mean, rng, SMALL)
  with pytest.raises(ValueError, match="no sequence has two captions"):
    lh.score([_sequence(rng, "a", rng.normal(size=(1, 3)))], real, _mean, rng, SMALL)
  with pytest.raises(ValueError, match="4 texts, 4 pieces and 3 captions"):
    sequence = _sequence(rng, "abcd", rng.normal(size=(4, 3)))._replace(captions=("a", "b", "c"))
    lh.score([sequence], real, _mean, rng, SMALL)
