"""Jerk, feet, floor and bones of motions whose answer is known."""
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.data.datasets import synthetic
from motion_jax.metrics import physics
from motion_jax.motion import rotations
from motion_jax.motion.skeleton import HUMANML3D

# A step of 5 cm over the ground that is of another length along any two axes; feet that stay low bob by 1 cm.
STEP, BOB = np.array([0.03, 0, 0.04]), np.array([0, 0.01, 0])


def still(frames=60):
  """A standing body with its lowest joint on the floor."""
  body = np.zeros((22, 3))
  for joint, parent in enumerate(HUMANML3D.parents):
    if parent >= 0:
      body[joint] = body[parent] + HUMANML3D.offsets[joint]
  body[:, 1] -= body[:, 1].min()
  return np.repeat(body[None], frames, axis=0)


def sliding(frames=41):
  """The standing body pushed over the ground by `STEP` a frame, 1 m/s, while it bobs."""
  frame = np.arange(frames)[:, None, None]
  return still(frames) + frame * STEP + frame % 2 * BOB


def test_jerk_of_a_polynomial():
  """x = a t^3 has the third difference 6 a; L1 over axes, the largest joint, per frame."""
  t = np.arange(60.0)
  joints = still()
  joints[:, 5] += np.outer(t**3, [1e-4, -2e-4, 0]) + np.outer(t**2, [1, 1, 1])
  joints[:, 6, 0] += 1e-4 * t**3
  np.testing.assert_allclose(physics.jerk(joints), 6 * 3e-4, rtol=1e-6)
  curve = physics.jerk_curve(np.stack([joints, still()]))
  assert curve.shape == (57,)
  assert physics.peak_jerk(curve) == pytest.approx(3 * 3e-4, rel=1e-6)
  assert physics.area_under_jerk(curve, 1e-4) == pytest.approx(57 * 8e-4, rel=1e-6)
  assert physics.area_under_jerk(physics.jerk_curve(still()[None])) == pytest.approx(57 * 0.033031363)


def test_transitions_are_cut_around_the_borders():
  motion = np.arange(200)
  cut = physics.cut_transitions(motion, [30, 100, 170])
  assert cut.shape == (3, 60) and cut[:, 0].tolist() == [0, 70, 140] and cut[1, 30] == 100
  for border in (29, 171):
    with pytest.raises(ValueError, match=f"border at frame {border} of 200"):
      physics.cut_transitions(motion, [100, border])


def test_transition_distance_sees_the_pose_only():
  joints = still(40)
  joints[20:, 15] += [0, 0.22, 0]
  found = physics.transition_distance(joints, [10, 20])
  np.testing.assert_allclose(found, [0, 0.22 / 22], atol=1e-12)
  angle = np.linspace(0, 5, 40)
  angle[20:] += 1.0  # heading and place may jump
  turned = rotations.rotate(rotations.about_axis(angle, "y")[:, None], joints)
  turned += np.arange(40)[:, None, None] * [1, 0, 2]
  np.testing.assert_allclose(physics.transition_distance(turned, [10, 20]), found, atol=1e-12)
  for border in (0, 40):
    with pytest.raises(ValueError, match="a motion of 40 frames"):
      physics.transition_distance(joints, [border])


def test_sliding_feet():
  """Two feet that slide at 1 m/s; steps count where a foot is low at both ends."""
  assert physics.skating_ratio(still(41)) == 0
  joints = sliding()
  assert physics.skating_ratio(joints) == 1.0
  np.testing.assert_allclose(physics.foot_speed(joints)[2:-2], 1.0, rtol=1e-9)
  assert physics.skating_ratio(joints, fast=2.0) == 0
  assert physics.skating_ratio(joints + [0, 0.2, 0]) == 0  # in the air
  lifted = joints.copy()
  lifted[21:, :, 1] += 0.2  # 20 of 40 steps are low at both ends; the one that lifts off does not count
  assert physics.skating_ratio(lifted) == 0.5
  assert physics.skating_ratio(np.stack([joints, still(41)])).tolist() == [1.0, 0]
  for foot in (HUMANML3D.left_feet, HUMANML3D.right_feet):  # one foot alone is enough, whichever
    one = still(41)
    one[:, foot] = joints[:, foot]
    assert physics.skating_ratio(one) == 1.0
    assert physics.slide(one) == pytest.approx(0.025)  # of two feet that are low, one slides
  assert physics.slide(np.stack([still(41), joints, joints + [0, 0.2, 0]])).round(9).tolist() == [0, 0.05, 0]


def test_feet_that_are_down_and_go_on():
  """The slowest point counts: a walker rests on one foot, a slider on none."""
  walking = still(41)
  walking[:, HUMANML3D.left_feet, 0] += 0.1 * np.arange(41)[:, None]
  assert physics.planted_speed(walking) == 0
  np.testing.assert_allclose(physics.planted_speed(sliding()), 1.0, rtol=1e-9)
  hopping = sliding()
  hopping[21:, :, 1] += 0.2  # in the air nothing is planted
  hopping[21:, :, 0] *= 3
  np.testing.assert_allclose(physics.planted_speed(hopping), 1.0, rtol=1e-9)
  assert physics.planted_speed(np.stack([still(41), sliding()])).round(9).tolist() == [0, 1]


def test_floor_bones_and_acceleration():
  joints = still(30)
  assert physics.floating(joints) == physics.penetration(joints) == 0
  assert physics.floating(joints + [0, 0.1, 0]) == pytest.approx(0.1)
  assert physics.penetration(joints - [0, 0.1, 0]) == pytest.approx(0.1)
  np.testing.assert_allclose(physics.foot_height(joints - [0, 0.1, 0]), -0.1)
  assert physics.bone_drift(joints) == pytest.approx(0, abs=1e-12)
  grows = joints.copy()
  grows[::2, 15, 2] += 0.04  # head: one bone of 21, 2 cm from its mean
  assert physics.bone_drift(grows) == pytest.approx(0.02 / 21)
  falls = joints - 0.5 * 9.81 * (np.arange(30.0)[:, None, None] / 20) ** 2 * np.array([0, 1, 0])
  assert physics.acceleration(falls, fps=20.0) == pytest.approx(9.81)
  with pytest.raises(ValueError, match="4 frames or more"):
    physics.jerk(joints[:3])


def test_a_summary_is_in_millimetres_and_seconds():
  """The same body on a skeleton whose unit is the millimetre has the same numbers."""
  found = physics.summary(sliding() + [0, 0.02, 0])
  assert found["slide_mm"] == pytest.approx(50) and found["planted_speed"] == pytest.approx(1)
  assert found["skating_ratio"] == 1 and found["floating_mm"] == pytest.approx(20 + 10 * 20 / 41)
  assert physics.summary(still() - BOB)["penetration_mm"] == pytest.approx(10)
  assert found["peak_jerk"] == pytest.approx(0.04)  # a bob of 1 cm up and down: 1 + 3 + 3 + 1 halves
  shrunk = dataclasses.replace(HUMANML3D, unit=0.001)
  for name, value in physics.summary(1000 * (sliding() + [0, 0.02, 0]), skeleton=shrunk).items():
    assert value == pytest.approx(found[name]), name


@pytest.mark.parametrize("measure", [physics.foot_height, physics.bone_drift, physics.skating_ratio])
def test_joints_of_another_skeleton_are_refused(measure, as_users_run):
  with pytest.raises(ValueError, match="got 24 joints, skeleton 'humanml3d' has 22"):
    measure(np.zeros((10, 24, 3)))
  with pytest.raises(ValueError, match=r"got joints of shape \(10, 66\)"):
    measure(np.zeros((10, 66)))


MEASURES = {name: getattr(physics, name) for name in (
    "jerk", "foot_speed", "skating_ratio", "planted_speed", "foot_height", "floating", "penetration", "bone_drift",
    "acceleration", "slide")}


@jax.jit
def measured(joints):
  """All measures of joints (N, T, J, 3) in one program."""
  distances = jax.vmap(lambda one: physics.transition_distance(one, [10, 20]))(joints)
  return {name: measure(joints) for name, measure in MEASURES.items()} | {"transition_distance": distances}


def moving_bodies(frames=40):
  """A standing body, a walk, and the walk with sliding feet, sunk in and shaken: joints (3, T, 22, 3), float64."""
  walk = synthetic.synthetic_clips(num=2, num_frames=frames)[1].joints[:frames].astype(np.float64)
  rough = walk + np.random.default_rng(0).normal(0, 0.01, walk.shape) - [0, 0.02, 0]
  return np.stack([still(frames), walk, rough + np.linspace(0, 1, frames)[:, None, None] * [1, 0, 0]])


def test_jax_arrays_give_the_numbers_of_numpy():
  """Inside jit, a batch at once, in float64 to 1e-9; the type of the joints is kept."""
  joints = moving_bodies()
  expected = {name: measure(joints) for name, measure in MEASURES.items()} | {
      "transition_distance": np.stack([physics.transition_distance(one, [10, 20]) for one in joints])}
  with jax.enable_x64(True):
    exact = measured(jnp.asarray(joints))
  rounded = jax.eval_shape(measured, joints.astype(np.float32))
  for name, numbers in expected.items():
    assert exact[name].dtype == jnp.float64 or name == "skating_ratio"
    assert rounded[name].dtype == jnp.float32 and rounded[name].shape == numbers.shape
    np.testing.assert_allclose(exact[name], numbers, atol=1e-9, err_msg=name)


@pytest.mark.slow
def test_gradients_are_finite_where_nothing_moves():
  """Each measure can be a loss; that of skating as a speed has a slope where feet slide."""
  joints = np.concatenate([moving_bodies(), np.zeros((1, 40, 22, 3))]).astype(np.float32)
  slopes = jax.jit(jax.jacrev(lambda joints: {name: one.sum() for name, one in measured(joints).items()}))(joints)
  for name, slope in slopes.items():
    assert np.isfinite(slope).all(), name
  assert np.abs(slopes["foot_speed"][2]).max() > 0 and np.abs(slopes["planted_speed"][2]).max() > 0
