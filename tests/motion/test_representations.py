"""SnapMoGen's 296, MotionStreamer's 272 and BABEL's 135 numbers: their columns, and the way back to joints."""
import functools

import jax.numpy as jnp
import numpy as np

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import inverse
from motion_jax.motion import representations as F
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import babel, motionstreamer
from motion_jax.motion.skeleton import HUMANML3D, SMPL, SNAPMOGEN, SNAPMOGEN_BVH, facing
from motion_jax.motion.transfer import from_22, to_22

WALK, CURVE = 1, 3


@functools.cache
def _clips(layout):
  """Made once for a layout; read only."""
  return synthetic_clips(0, 6, skeleton=F.get_layout(layout).skeleton)


def _turned(joints, angle):
  return rot.rotate(rot.about_axis(np.array(angle), "y"), joints.astype(np.float64)) + [3.0, 0, -2.0]


def test_where_benchmark_features_depend_on_the_world():
  """The faults that "corrected" mends are there in "benchmark", which follows the released code."""
  clip = _clips("snapmogen")[CURVE]
  turns = F.to_features(_turned(clip.joints, 2.9), "snapmogen", "benchmark")[:, 0]
  assert 6.0 < np.abs(turns).max() < 6.5
  right = F.to_features(clip.joints, "snapmogen", "corrected")[:, 0]
  assert np.abs((turns - right + np.pi) % (2 * np.pi) - np.pi).max() < 0.01


def test_columns_of_296():
  """The table of the docstring, on a walk straight ahead."""
  clip = _clips("snapmogen")[WALK]
  joints = clip.joints.astype(np.float64)
  layout = F.get_layout("snapmogen")
  x = F.to_features(joints, layout, "corrected")
  assert np.abs(x[:, layout["turn"]]).max() < 1e-3
  assert np.allclose(x[:, 2], np.diff(joints[:, 0, 2]), atol=1e-3) and np.abs(x[:, 1]).max() < 0.05
  positions = x[:, layout["positions"]].reshape(-1, 24, 3)
  assert np.array_equal(positions[:, 0, 1], x[:, 3]) and (positions[:, 0, [0, 2]] == 0).all()
  assert np.allclose(positions[:, 15], positions[:, 0])  # root and pelvis are one point
  velocities = x[:, layout["velocities"]].reshape(-1, 24, 3)
  assert np.allclose(np.diff(positions, axis=0), velocities[:-1], atol=1e-4)
  feet = joints[:, [18, 19, 22, 23], 1]
  assert np.isclose(joints[0, 0, 1] - x[0, 3], np.sort(feet.ravel())[:feet.size // 10].mean(), atol=1e-4)
  matrix = rot.matrix_from_6d(x[:, layout["rotations"]].reshape(-1, 24, 6))
  knee = np.einsum("tij,j->ti", matrix[:, 16], SNAPMOGEN.offsets[17])  # rotations are global: a hip's turns its knee
  assert np.abs(knee - (positions[:, 17] - positions[:, 16])).max() < 1e-3
  assert set(np.unique(x[:, layout["contacts"]])) == {0, 1}


def test_columns_of_272():
  clip = _clips("motionstreamer")[CURVE]
  joints = clip.joints.astype(np.float64)
  turned = inverse.world_rotations(joints, SMPL)
  x = motionstreamer.from_rotations(joints, inverse.relative(turned, SMPL))
  layout = F.get_layout("motionstreamer")
  assert (x[0, :2] == 0).all() and (x[0, 2:8] == [1, 0, 0, 0, 1, 0]).all() and (x[0, layout["velocities"]] == 0).all()
  assert np.abs(x[:, [3, 5, 7]]).max() < 1e-12 and np.abs(x[:, 6] - 1).max() < 1e-12  # turns about the vertical alone
  assert (x[:, 4] * x[:, 4] + x[:, 2] * x[:, 2]).std() < 1e-12
  positions = x[:, layout["positions"]].reshape(-1, 22, 3)
  assert np.allclose(np.diff(positions, axis=0), x[1:, layout["velocities"]].reshape(-1, 22, 3))
  root = motionstreamer.matrix_from_rows(x[:, layout["rotations"]].reshape(-1, 22, 6))[:, 0]
  assert np.abs(root[:, 0, 2]).max() < 1e-12 and (root[:, 2, 2] > 0.9).all()  # its front has no sideways part
  assert positions[..., 1].min() == 0


def test_later_turns_of_272_are_multiplied_from_the_left():
  """Turns about the vertical commute; those that a network tilts do not, as a quarter about x, then one about y."""
  quarters = rot.to_matrix(np.stack([rot.about_axis(np.array(np.pi / 2), axis) for axis in "xy"]))
  for path in (motionstreamer._products(quarters), motionstreamer._products(jnp.asarray(quarters))):
    np.testing.assert_allclose(path[1], quarters[1] @ quarters[0], atol=1e-6)
    # The quarter about x takes z to -y, which the one about y leaves there.
    np.testing.assert_allclose(np.asarray(path[1]) @ [0, 0, 1], [0, -1, 0], atol=1e-6)


def test_columns_of_135():
  clip = _clips("babel")[WALK]
  joints = clip.joints.astype(np.float64)
  rotations, translation = babel.from_ours(joints, inverse.world_rotations(joints, SMPL))
  x = babel.from_rotations(rotations, translation, "corrected")
  assert np.allclose(x[:, 0], joints[:, 0, 1]) and (x[0, 1:3] == 0).all()
  assert np.allclose(x[1:, 1], -np.diff(joints[:, 0, 2]), atol=1e-3)  # ahead is -x
  rows = x[:, 3:9].reshape(-1, 2, 3)
  assert rows[:, 0, 2].max() < -0.9 and rows[:, 1, 0].max() < -0.9  # front to -x, left to -y, as FlowMDM's own means
  assert np.allclose(x[:, 9:].reshape(-1, 21, 6), motionstreamer.to_rows(rotations[:, 1:]))


def test_the_reference_s_heading_of_135():
  """Closed form: upright in AMASS (90 degrees about x) and turned by 90 is (1, 1, 1) / sqrt 3 by 120 degrees."""
  upright = rot.multiply(rot.about_axis(np.array(np.pi / 2), "z"), rot.about_axis(np.array(np.pi / 2), "x"))
  assert np.isclose(babel._yaw(upright, "benchmark"), 2 * np.pi / 3 / np.sqrt(3))
  assert np.isclose(babel._yaw(-upright, "benchmark"), 2 * np.pi / 3 / np.sqrt(3))
  assert np.isclose(babel._yaw(upright, "corrected"), np.pi / 2)


def test_rotations_from_joints_are_the_body_s():
  """A body moved by known rotations: bones with several neighbours come back, the rest point the right way."""
  rng = np.random.default_rng(0)
  for skeleton in (SMPL, SNAPMOGEN):
    local = rot.from_vector(rng.normal(size=(5, skeleton.num_joints, 3)) * 0.3)
    turned = local.copy()
    for joint in skeleton.order[1:]:
      if np.linalg.norm(skeleton.offsets[joint]) < 1e-6:
        local[:, joint] = [1, 0, 0, 0]
      turned[:, joint] = rot.multiply(turned[:, skeleton.parents[joint]], local[:, joint])
    joints = inverse.forward(rng.normal(size=(5, 3)), turned, skeleton)
    found = inverse.world_rotations(joints, skeleton)
    assert np.abs(inverse.forward(joints[:, 0], found, skeleton) - joints).max() < 1e-9
    assert np.abs(np.abs((found[:, 0] * turned[:, 0]).sum(-1)) - 1).max() < 1e-9
    assert np.abs(np.abs((inverse.relative(turned, skeleton) * local).sum(-1)) - 1).max() < 1e-9


def test_skeletons():
  assert SNAPMOGEN.num_joints == 24 == len(SNAPMOGEN_BVH) and SMPL.parents == HUMANML3D.parents
  for skeleton in (SMPL, SNAPMOGEN):
    mirrored = skeleton.offsets[list(skeleton.mirror)] * [-1, 1, 1]
    assert np.abs(mirrored - skeleton.offsets).max() < 2e-3
  joints = synthetic_clips(0, 2)[1].joints
  back = to_22(from_22(joints, SNAPMOGEN))
  assert back.shape == joints.shape
  raised, feet = to_22(from_22(joints + np.float32([0, 0.5, 0]), SNAPMOGEN)), [7, 8, 10, 11]
  assert np.isclose(raised[:, feet, 1].min(), joints[:, feet, 1].min() + 0.5, atol=1e-6)
  assert facing(back.astype(np.float64), HUMANML3D)[0] @ facing(joints.astype(np.float64), HUMANML3D)[0] > 0.99
