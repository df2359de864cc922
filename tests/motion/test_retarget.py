"""Retargeting changes proportions and nothing else: bones exact, feet as firm as before, the floor at zero."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import ACTIONS, synthetic_clips, synthetic_joints
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import floor_height, leg_scale, retarget, with_lengths
from motion_jax.motion.skeleton import HUMANML3D

PARENTS = np.maximum(HUMANML3D.parents, 0)
FEET = list(HUMANML3D.left_feet + HUMANML3D.right_feet)


def _other_body(joints, seed=0):
  """The same bone directions with other bone lengths, half the size, somewhere else."""
  factors = 0.5 * np.random.default_rng(seed).uniform(0.8, 1.25, HUMANML3D.num_joints)
  right = [j for j, m in enumerate(HUMANML3D.mirror) if m < j]
  factors[right] = factors[[HUMANML3D.mirror[j] for j in right]]  # a symmetric body
  result = 0.5 * joints + [3.0, 0.2, -1.0]
  for joint in range(1, HUMANML3D.num_joints):
    bone = joints[:, joint] - joints[:, PARENTS[joint]]
    result[:, joint] = result[:, PARENTS[joint]] + factors[joint] * bone
  return result


def _lengths(joints):
  return np.linalg.norm(joints - joints[:, PARENTS], axis=-1)


@pytest.mark.parametrize("feet", [True, False])
def test_bones_become_canonical(feet):
  for clip in synthetic_clips(0, len(ACTIONS), num_frames=60):
    result = retarget(_other_body(clip.joints.astype(np.float64)), feet=feet)
    assert result.dtype == np.float64
    np.testing.assert_allclose(_lengths(result), np.broadcast_to(HUMANML3D.bone_lengths, (60, 22)), atol=1e-9)
    assert abs(floor_height(result)) < 1e-9


def test_canonical_body_is_left_alone():
  for clip in synthetic_clips(1, len(ACTIONS), num_frames=60):
    joints = clip.joints.astype(np.float64)
    joints[..., 1] -= floor_height(joints)
    assert np.abs(retarget(joints) - joints).max() < 0.006


def test_standing_feet_stand():
  """Feet that do not move in the source slide less than with directions alone, and by less than 2 mm per frame."""
  joints = synthetic_joints("walk", 100, np.random.default_rng(0))
  source = _other_body(joints, seed=3)
  # A source whose own toes and ankles are planted: its feet are the walk's feet, at half the size.
  source[:, FEET] = 0.5 * joints[:, FEET] + [3.0, 0.2, -1.0]
  step = np.linalg.norm(np.diff(joints[:, FEET], axis=0), axis=-1)
  planted = step < 1e-3
  slide = lambda x: np.linalg.norm(np.diff(x[:, FEET], axis=0)[..., [0, 2]], axis=-1)[planted]
  with_feet, without = slide(retarget(source)), slide(retarget(source, feet=False))
  assert with_feet.mean() < 2e-3 and with_feet.mean() < 0.5 * without.mean()


def test_direction_of_the_foot_and_trunk_stay():
  source = _other_body(synthetic_joints("squat", 50, np.random.default_rng(1)))
  result = retarget(source)
  for joint in (10, 11, 3, 12, 15, 18, 21):
    a, b = (x[:, joint] - x[:, PARENTS[joint]] for x in (source, result))
    cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    np.testing.assert_allclose(cosine, 1, atol=1e-9)


def test_size_and_place_do_not_matter():
  joints = _other_body(synthetic_joints("jump", 60, np.random.default_rng(2)))
  np.testing.assert_allclose(retarget(100 * joints), retarget(joints), atol=1e-9)
  moved = retarget(joints + [0, 5.0, 0])
  np.testing.assert_allclose(moved, retarget(joints), atol=1e-9)
  np.testing.assert_allclose(leg_scale(10 * joints) * 10, leg_scale(joints))


def test_one_spike_does_not_lift_the_clip():
  joints = synthetic_joints("stand", 60, np.random.default_rng(0))
  spiked = joints.copy()
  spiked[30, 10, 1] -= 0.5
  assert abs(np.median(retarget(spiked)[:, 0, 1]) - np.median(retarget(joints)[:, 0, 1])) < 0.005


@pytest.mark.parametrize("axis, angle", [("y", 0.0), ("y", np.pi), ("x", np.pi / 2)])
def test_a_bone_of_no_length_points_as_the_body_does(axis, angle):
  """Collars in the chest and a spine from the pelvis itself, facing any way or lying: never along the world's axes."""
  joints = synthetic_joints("walk", 40, np.random.default_rng(0))
  joints[:, [13, 14]] = joints[:, [9]]
  joints[:, 3] = joints[:, 0]
  turned = rot.rotate(rot.about_axis(angle, axis), joints)
  result = with_lengths(turned, HUMANML3D)
  shoulders, hips = result[:, 16] - result[:, 17], result[:, 1] - result[:, 2]
  assert 0.3 < np.median(np.linalg.norm(shoulders, axis=-1)) < 0.48
  assert np.degrees(np.arccos((rot.unit(shoulders) * rot.unit(hips)).sum(-1))).max() < 40
  straight = with_lengths(joints, HUMANML3D)
  np.testing.assert_allclose(result, rot.rotate(rot.about_axis(angle, axis), straight), atol=1e-6)


def test_bad_input():
  with pytest.raises(ValueError, match="expected .frames, 22, 3"):
    retarget(np.zeros((5, 24, 3)))
  joints = synthetic_joints("walk", 10, np.random.default_rng(0))
  joints[4, 3, 1] = np.nan
  with pytest.raises(ValueError, match="frame 4"):
    retarget(joints)
  with pytest.raises(ValueError, match="no length"):
    retarget(np.zeros((5, 22, 3)))
