"""Whole poses: met exactly, limbs that do not dart between them, a motion's own steps between poses far apart, and the
bones of a body of another build."""
import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from motion_jax.control import poses
from motion_jax.control.compiling import clip_to_feasible
from motion_jax.control.project import project
from motion_jax.control.signal import ControlSignal
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

COUNT, FPS = 80, 20.0


def _body(action, seed, longer=1.0, count=COUNT):
  """A motion on bones that are longer by a factor, its feet on the floor."""
  joints = synthetic_joints(action, count, np.random.default_rng(seed)).astype(np.float64)
  made = with_lengths(joints, dataclasses.replace(HUMANML3D, bone_lengths=HUMANML3D.bone_lengths * longer))
  return made + [0, np.percentile(joints[:, 10, 1], 5) - np.percentile(made[:, 10, 1], 5), 0]


def _asked(joints, frames):
  given = np.zeros((1, *joints.shape), bool)
  given[0, frames] = True
  none = np.zeros((1, len(joints)), np.float32)
  return ControlSignal(np.where(given, joints, 0).astype(np.float32), given, none, none > 0)


def _fastest(joints):
  return np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() * FPS


def _given(frames):
  given = np.zeros(COUNT, bool)
  given[frames] = True
  return given


@pytest.mark.parametrize("action", ["walk", "jump"])
def test_between_thick_poses_a_motion_that_shivers_goes_as_the_poses_do(action):
  """A motion whose joints wander about by some centimetres is brought near the one of the poses."""
  rng = np.random.default_rng(0)
  real = _body(action, 1)
  noise = gaussian_filter1d(rng.normal(size=real.shape), 2.0, axis=0)
  start = with_lengths(real + 0.05 * noise / noise.std(), HUMANML3D)
  frames = np.sort(rng.choice(COUNT, COUNT // 4, replace=False))
  made = project(start, _asked(real, frames), warn=False).astype(np.float64)
  assert np.abs(made - real)[frames].max() < 1e-3
  assert np.abs(bone_lengths(made, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-4
  inside = slice(frames[0], frames[-1] + 1)
  assert _fastest(made[inside]) < max(_fastest(start[inside]), 1.3 * _fastest(real))
  assert np.abs(made - real)[inside].mean() < 0.4 * np.abs(start - real)[inside].mean()


def test_limbs_do_not_dart_between_poses_of_quite_another_motion():
  start, real = _body("walk", 1), _body("wave_left", 2)
  start = start - start[:, :1] * [1, 0, 1] + real[:, :1] * [1, 0, 1]
  frames = np.arange(0, COUNT, 5)
  made = project(start, _asked(real, frames), warn=False)
  assert np.abs(made - real)[frames].max() < 1e-3
  assert _fastest(made) < 1.5 * _fastest(real)


def test_a_walk_keeps_its_steps_between_poses_that_are_far_apart():
  """Poses of the walk itself, a second and a half apart: a way straight from one to the next has no steps."""
  walk = _body("walk", 1)
  made = poses.meet_poses(walk, walk, _given([10, 40, 70]), HUMANML3D.bone_lengths, FPS)
  np.testing.assert_allclose(made, walk, atol=1e-5)
  moved = walk + [0.1, 0, 0]
  made = poses.meet_poses(walk, moved, _given([10, 40, 70]), HUMANML3D.bone_lengths, FPS)
  assert np.abs(made - moved)[[10, 40, 70]].max() < 1e-9
  assert np.abs((made - made[:, :1]) - (walk - walk[:, :1])).max() < 1e-5  # the body is shifted, no more


def test_no_pose_and_short_motions_are_left_alone():
  walk = _body("walk", 1)
  assert poses.meet_poses(walk, walk + 1, _given([]), HUMANML3D.bone_lengths, FPS) is walk
  assert poses.meet_poses(walk[:2], walk[:2] + 1, _given([0])[:2], HUMANML3D.bone_lengths, FPS).shape == (2, 22, 3)


def test_a_pose_on_a_ladder_stays_there_and_one_in_the_sky_comes_down_as_it_is():
  walk = _body("walk", 1)
  climbs = clip_to_feasible(_asked(walk + [0, 1.2, 0], [10]), warn=False)
  np.testing.assert_allclose(climbs.positions[0, 10], (walk + [0, 1.2, 0])[10], atol=1e-6)
  with pytest.warns(UserWarning, match="out of reach; the limit is"):
    flies = clip_to_feasible(_asked(walk + [0, 90, 0], [10]))
  pose = flies.positions[0, 10]
  np.testing.assert_allclose(pose - pose[0], walk[10] - walk[10, 0], atol=1e-4)
  assert 1 < pose[:, 1].min() < 6


def test_a_hand_is_flung_faster_than_a_body_runs():
  signal = _asked(np.zeros((COUNT, 22, 3)), [])
  for joint, metres in ((20, 0.6), (21, 1.0), (0, 0.6)):  # in a frame: 12, 20 and 12 m/s; a hand has 17.5, a body 7
    signal.given[0, [5, 6], joint] = True
    signal.positions[0, [5, 6], joint] = [[0, 1, 0], [metres, 1, 0]]
  clipped = clip_to_feasible(signal, warn=False).positions[0, 6, :, 0]
  np.testing.assert_allclose(clipped[[20, 21, 0]], [0.6, 0.875, 0.35], atol=1e-6)


def test_a_pose_turned_half_round_turns_the_body_there():
  """Given as arrays, without a heading, it is met without the limbs turned inside out."""
  walk = _body("walk", 1)
  turned = walk * [-1, 1, -1]
  frame = 40
  pose = np.where(np.arange(COUNT)[:, None, None] == frame, turned - turned[frame, 0] * [1, 0, 1]
                  + walk[frame, 0] * [1, 0, 1], 0)
  made = project(walk, _asked(pose, [frame]), warn=False)
  assert np.abs(made[frame] - pose[frame]).max() < 1e-3
  assert _fastest(made.astype(np.float64)) < 12


@pytest.mark.parametrize("action, longer", [("walk", 1.06), ("squat", 0.93)])
def test_poses_at_a_quarter_of_frames_are_met_on_their_own_bones(action, longer):
  source, start = _body(action, 1, longer, 60), _body(action, 2, count=60)
  frames = np.random.default_rng(0).choice(60, 15, replace=False)
  made = project(start, _asked(source, frames), warn=False).astype(np.float64)
  assert np.abs(made - source)[frames].max() < 1e-3
  lengths = bone_lengths(made, HUMANML3D)
  assert np.abs(lengths - bone_lengths(source, HUMANML3D).mean(0)).max() < 1e-3  # in all frames
  assert _fastest(made) < 2 * max(_fastest(source), _fastest(start))


def test_a_body_is_only_taken_on_where_all_poses_show_one():
  start, small, tall = _body("walk", 1), _body("walk", 2, 0.95), _body("walk", 3, 1.05)
  several = np.where(np.arange(COUNT)[:, None, None] < 30, small, tall)
  assert poses.lengths_from_poses(_asked(several, [10, 40])) is None
  assert poses.lengths_from_poses(_asked(3 * small, [10])) is None  # no person
  hand = _asked(small, [10])
  hand = hand.replace(given=hand.given & (np.arange(22) == 20)[:, None])
  assert poses.lengths_from_poses(hand) is None
  for signal in (_asked(several, [10, 40]), hand, _asked(start, [10])):
    np.testing.assert_array_equal(poses.with_build(start, poses.lengths_from_poses(signal)), start)


def test_a_pose_under_the_floor_does_not_change_the_bones():
  """It comes up as a whole, which makes its legs no shorter."""
  source = _body("walk", 2)
  made = project(_body("walk", 1), _asked(source - [0, 0.05, 0], [30]), warn=False).astype(np.float64)
  assert np.abs(bone_lengths(made, HUMANML3D) - bone_lengths(source, HUMANML3D)).max() < 1e-4


def test_other_targets_stay_met_on_bones_that_differ_little():
  start, source = _body("walk", 1), _body("walk", 1, 1.004)
  signal, hand = _asked(source, [10]), start[40, 20] + [0.05, 0.1, 0.05]
  signal.given[0, 40, 20], signal.positions[0, 40, 20] = True, hand
  made = project(start, signal, warn=False).astype(np.float64)
  assert np.abs(made[40, 20] - hand).max() < 1e-3 and np.abs(made[10] - source[10]).max() < 1e-3
