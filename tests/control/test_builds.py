"""Poses of a body of another build: the motion takes it on, and meets them to a millimetre."""
import dataclasses

import numpy as np
import pytest

from motion_jax.control import poses
from motion_jax.control.project import project
from motion_jax.control.signal import ControlSignal
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.metrics.physics import planted_speed
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

COUNT = 60


def _body(action, seed, longer=1.0):
  """A motion on bones that are so many times longer."""
  joints = synthetic_joints(action, COUNT, np.random.default_rng(seed)).astype(np.float64)
  lengths = HUMANML3D.bone_lengths * longer
  made = with_lengths(joints, dataclasses.replace(HUMANML3D, bone_lengths=lengths))
  return made + [0, np.percentile(joints[:, 10, 1], 5) - np.percentile(made[:, 10, 1], 5), 0]


def _poses(joints, frames):
  given = np.zeros((1, *joints.shape), bool)
  given[0, frames] = True
  none = np.zeros((1, len(joints)))
  return ControlSignal(np.where(given, joints, 0).astype(np.float32), given, none.astype(np.float32), none > 0)


@pytest.mark.parametrize("action, longer", [("walk", 1.06), ("squat", 0.93), ("wave_left", 1.0)])
def test_poses_at_a_quarter_of_frames_are_met_on_their_own_bones(action, longer):
  source, start = _body(action, 1, longer), _body(action, 2)
  frames = np.random.default_rng(0).choice(COUNT, COUNT // 4, replace=False)
  made = project(start, _poses(source, frames), warn=False).astype(np.float64)
  assert np.abs(made - source)[frames].max() < 1e-3
  lengths = bone_lengths(made, HUMANML3D)
  assert np.abs(lengths - bone_lengths(source, HUMANML3D).mean(0)).max() < 1e-3  # in all frames
  fastest = lambda joints: np.linalg.norm(np.diff(joints, axis=0), axis=-1).max()
  assert fastest(made) < 2 * max(fastest(source), fastest(start))


def test_feet_stand_on_other_bones_as_they_stood():
  start = _body("walk", 1)
  made = poses.with_build(start, poses.lengths_from_poses(_poses(_body("walk", 2, 1.06), [5])))
  assert np.abs(bone_lengths(made, HUMANML3D)[:, 1:] / HUMANML3D.bone_lengths[1:] - 1.06).max() < 1e-5
  assert planted_speed(made) < 1.5 * planted_speed(start) + 0.02


def test_a_body_is_only_taken_on_where_all_poses_show_one():
  start, small, tall = _body("walk", 1), _body("walk", 2, 0.95), _body("walk", 3, 1.05)
  several = np.where(np.arange(COUNT)[:, None, None] < 30, small, tall)
  assert poses.lengths_from_poses(_poses(several, [10, 40])) is None
  assert poses.lengths_from_poses(_poses(3 * small, [10])) is None  # no person
  hand = _poses(small, [10])
  hand = hand.replace(given=hand.given & (np.arange(22) == 20)[:, None])
  assert poses.lengths_from_poses(hand) is None
  for signal in (_poses(several, [10, 40]), hand, _poses(start, [10])):
    np.testing.assert_array_equal(poses.with_build(start, poses.lengths_from_poses(signal)), start)


def test_a_pose_under_the_floor_does_not_change_the_bones():
  """It comes up as a whole, which makes its legs no shorter."""
  source = _body("walk", 2)
  made = project(_body("walk", 1), _poses(source - [0, 0.05, 0], [30]), warn=False).astype(np.float64)
  assert np.abs(bone_lengths(made, HUMANML3D) - bone_lengths(source, HUMANML3D)).max() < 1e-4


def test_what_else_is_asked_for_stays_met_on_bones_that_differ_little():
  start, source = _body("walk", 1), _body("walk", 1, 1.004)
  signal, hand = _poses(source, [10]), start[40, 20] + [0.05, 0.1, 0.05]
  signal.given[0, 40, 20], signal.positions[0, 40, 20] = True, hand
  made = project(start, signal, warn=False).astype(np.float64)
  assert np.abs(made[40, 20] - hand).max() < 1e-3 and np.abs(made[10] - source[10]).max() < 1e-3
