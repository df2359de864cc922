"""Fit a rigid skeleton to a motion: one rest pose for all motions of a model, and the rotations that fit best.

A rig has bones of constant length and a rigid pelvis and chest. The joints of a network satisfy the first exactly, the
second to a centimetre. `fit_pose` finds the root path and rotations whose joints are nearest to the motion's. Rotations
alone then describe the motion, and all files of one model move the same rig.
"""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import Pose, to_pose
from motion_jax.motion.skeleton import Skeleton, bone_lengths, t_pose
from motion_jax.shapes import Array, Float, Num

_SAME_BONES = 0.01  # metres: a body whose mean bone lengths differ less gets the skeleton's own rig
_FEET, _HANDS = 30.0, 3.0  # weights of the squared distances of feet and hands, those of other joints being 1
_DAMPING = 1e-3     # metres^2 per radian^2: how strongly a joint resists turning in one step, most in straight limbs
_STEPS, _CHUNK = 6, 2000


def rest_offsets(joints: Num[Array, "t j 3"], skeleton: Skeleton, fps: float = 20.0) -> Float[np.ndarray, "j 3"]:
  """The T-pose offsets (J, 3) of the rig for joints (T, J, 3).

  Those of the skeleton if the body has its bone lengths, as in all motions of a model; else those of the body, rounded
  to tenths of a millimetre: two recordings of one person then share them.
  """
  lengths = bone_lengths(np.asarray(joints, np.float64), skeleton).mean(0)
  if np.abs(lengths - skeleton.bone_lengths).max() * skeleton.unit < _SAME_BONES:
    return t_pose(skeleton)
  step = 1e-4 / skeleton.unit
  return np.round(rot.unit(to_pose(joints, skeleton, fps).offsets, eps=1e-9) * lengths[:, None] / step) * step


def fit_pose(joints: Num[Array, "t j 3"], skeleton: Skeleton, fps: float = 20.0,
             rest: Float[np.ndarray, "j 3"] | None = None) -> Pose:
  """Root path and rotations of a rig with offsets rest (J, 3) whose joints are nearest to joints (T, J, 3).

  Gauss-Newton on the squared distances of all joints, with larger weights for feet and hands; twists of limbs stay as
  `to_pose` chooses them. rest: `rest_offsets` by default. `shifts` are zero. float64.
  """
  joints = np.asarray(joints, np.float64)
  rest = rest_offsets(joints, skeleton, fps) if rest is None else rest
  pose = to_pose(joints, skeleton, fps, rest)
  pieces = [_fitted(joints[first:first + _CHUNK], pose.root[first:first + _CHUNK], pose.turned[first:first + _CHUNK],
                    rest, skeleton) for first in range(0, len(joints), _CHUNK)]
  root, turned = (np.concatenate(parts) for parts in zip(*pieces))
  parents = np.maximum(skeleton.parents, 0)
  local = rot.multiply(rot.conjugate(turned[:, parents]), turned)
  local[:, 0] = turned[:, 0]
  return Pose(rest, np.zeros_like(joints), root, rot.continuous(rot.unit(local)), rot.continuous(turned))


def _fitted(joints, root, turned, rest, skeleton):
  """Root path (T, 3) and world rotations (T, J, 4) after `_STEPS` steps of Gauss-Newton from the given ones."""
  parents, number = skeleton.parents, skeleton.num_joints
  movers = sorted(set(parents[1:]))
  weights = np.ones(number)
  weights[list(skeleton.left_feet + skeleton.right_feet)] = _FEET
  weights[[j for j, name in enumerate(skeleton.joints) if name.endswith("wrist")]] = _HANDS
  metre = 1 / skeleton.unit
  for _ in range(_STEPS):
    bones = rot.rotate(turned[:, np.maximum(parents, 0)], rest)
    places, slopes = np.empty_like(joints), np.zeros(joints.shape + (3 * len(movers) + 3,))
    places[:, 0], slopes[:, 0, :, -3:] = root, np.eye(3)
    for joint in skeleton.order[1:]:
      parent = parents[joint]
      places[:, joint] = places[:, parent] + bones[:, joint]
      slopes[:, joint] = slopes[:, parent]
      column = 3 * movers.index(parent)
      slopes[:, joint, :, column:column + 3] = _turn_slope(bones[:, joint])
    slopes = slopes.reshape(len(joints), 3 * number, -1)
    weighted = slopes * np.repeat(weights, 3)[:, None]
    matrix = weighted.swapaxes(1, 2) @ slopes
    matrix[:, range(3 * len(movers)), range(3 * len(movers))] += _DAMPING * metre ** 2
    step = np.linalg.solve(matrix, weighted.swapaxes(1, 2) @ (joints - places).reshape(len(joints), -1, 1))[..., 0]
    root = root + step[:, -3:]
    turns = np.zeros_like(joints)
    turns[:, movers] = step[:, :-3].reshape(len(joints), -1, 3)
    turned = rot.unit(rot.multiply(rot.from_vector(turns), turned))
  # The end of a limb turns with its parent.
  ends = [j for j in range(number) if j not in movers]
  before = [parents[j] for j in ends]
  turned[:, ends] = turned[:, before]
  return root, turned



def _turn_slope(bone):
  """Derivative (T, 3, 3) of the end of bones (T, 3) by a rotation vector in the world: w -> w x bone."""
  slope = np.zeros((len(bone), 3, 3))
  for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    slope[:, a, b], slope[:, a, c] = bone[:, c], -bone[:, b]
  return slope
