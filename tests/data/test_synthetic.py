"""Synthetic clips do what their captions say, on the canonical skeleton."""
import numpy as np

from motion_jax.data.datasets.synthetic import ACTIONS, synthetic_clips
from motion_jax.motion.skeleton import HUMANML3D

PARENTS = np.maximum(HUMANML3D.parents, 0)


def _turned(joints):
  """Total change of heading in radians, positive to the left (+x when facing +z)."""
  across = joints[:, 1] - joints[:, 2]
  angle = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
  return angle[-1] - angle[0]


def test_same_seed_same_clips():
  a, b, other = synthetic_clips(3, 4), synthetic_clips(3, 4), synthetic_clips(4, 4)
  assert all(np.array_equal(x.joints, y.joints) for x, y in zip(a, b))
  assert not np.array_equal(a[1].joints, other[1].joints[:len(a[1].joints)])
  assert np.array_equal(synthetic_clips(3, 2)[1].joints, a[1].joints)  # more clips do not change the first ones
  assert synthetic_clips(0, 1, num_frames=40)[0].num_frames == 40


def test_bones_keep_their_length_and_feet_the_floor():
  for clip in synthetic_clips(0, len(ACTIONS)):
    lengths = np.linalg.norm(clip.joints - clip.joints[:, PARENTS], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(HUMANML3D.bone_lengths, lengths.shape), atol=1e-5)
    assert abs(clip.joints[..., 1].min()) < 0.01
    np.testing.assert_allclose(clip.joints[0, 0, [0, 2]], 0, atol=1e-6)


def test_captions_are_true():
  for clip in synthetic_clips(1, 2 * len(ACTIONS)):
    joints, action = clip.joints, clip.meta["action"]
    travel = joints[-1, 0] - joints[0, 0]
    if action in ("walk", "run"):
      assert travel[2] > 1 and abs(travel[0]) < 1e-3
    if action.endswith("_left") and "wave" not in action:
      assert _turned(joints) > 0.9
    if action.endswith("_right") and "wave" not in action:
      assert _turned(joints) < -0.9
    if action == "curve_left":
      assert travel[0] > 0.3
    if action == "wave_left":
      assert joints[:, 20, 1].max() > 1.5 > 1.2 > joints[:, 21, 1].max()
    if action == "jump":
      assert joints[:, [7, 8, 10, 11], 1].min(1).max() > 0.1
    if action == "squat":
      assert np.ptp(joints[:, 0, 1]) > 0.2
