"""Synthetic clips do what their captions say, on the canonical skeleton."""
import numpy as np

from motion_jax.data.datasets.synthetic import ACTIONS, synthetic_clips
from motion_jax.motion.skeleton import HUMANML3D

PARENTS = np.maximum(HUMANML3D.parents, 0)


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
    joints, (action, _, side) = clip.joints, clip.meta["action"].partition("_")
    across, travel = joints[:, 1] - joints[:, 2], joints[-1, 0] - joints[0, 0]
    angle = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))  # to the left, +x of a body that faces +z
    if action in ("walk", "run"):
      assert travel[2] > 1 and abs(travel[0]) < 1e-3
    elif action == "wave":
      raised = 20 if side == "left" else 21
      assert joints[:, raised, 1].max() > 1.5 > 1.2 > joints[:, 41 - raised, 1].max()
    elif side:
      assert (angle[-1] - angle[0]) * (1 if side == "left" else -1) > 0.9
    elif action in ("jump", "squat"):
      assert joints[:, [7, 8, 10, 11], 1].min(1).max() > 0.1 if action == "jump" else np.ptp(joints[:, 0, 1]) > 0.2
