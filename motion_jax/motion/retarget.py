"""Retarget the motion of any body to the canonical skeleton: its bone lengths, the same steps.

`rigs.map_joints` picks joints out of a file by name; `retarget` gives them canonical bone lengths without foot sliding;
`mirror` swaps left and right. numpy, float64, whole clips at once.
"""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, body_axes, t_pose
from motion_jax.shapes import Array, Float, Num

_FLOOR_PERCENTILE = 5     # of the lower foot's height over the clip: tracking spikes do not lift the clip
_SOFT_REACH = 0.985       # share of a straight leg from which on a knee resists being straighter than the source's
_KNEE_BIAS = 0.005        # metres ahead that the knee of a straight leg is assumed to bend
_NO_LENGTH = 1e-3         # of the legs' length: a shorter bone defines no direction


def retarget(joints: Num[Array, "*shape"], skeleton: Skeleton = HUMANML3D, feet: bool = True
             ) -> Float[np.ndarray, "t j 3"]:
  """Brings joints (T, J, 3) of any proportions to the skeleton's bone lengths without foot sliding. float64.

  Bone directions stay; the path is scaled by the ratio of leg lengths (both legs, median over the clip). With `feet`
  each ankle then follows the scaled source's by two-bone inverse kinematics in the source's knee plane: standing feet
  stay fixed. The floor, the 5th percentile of the lower foot's height, moves to y = 0. Raises ValueError for a wrong
  shape, numbers that are not finite, or legs of no length.
  """
  joints = np.asarray(joints, np.float64)
  if joints.ndim != 3 or joints.shape[1:] != (skeleton.num_joints, 3) or not len(joints):
    raise ValueError(f"got joints of shape {joints.shape}, expected (frames, {skeleton.num_joints}, 3) in the order of "
                     f"skeleton {skeleton.name!r}; rigs.map_joints picks them from a file")
  if not np.isfinite(joints).all():
    raise ValueError(f"joints hold NaN or infinity, first in frame {np.argwhere(~np.isfinite(joints))[0, 0]}")
  legs = [chain[1:] for chain in skeleton.chains[:2]]  # hip, knee, ankle, (heel,) toes
  scale = leg_scale(joints, skeleton)
  source = joints * scale
  result = with_lengths(source, skeleton)
  # The middle between the hips keeps its path, not the pelvis: legs start there, and trunks differ most above it.
  hips = [leg[0] for leg in legs]
  result += (source[:, hips] - result[:, hips]).mean(1, keepdims=True)
  if feet:
    moves = [foot_move(source, result, leg, skeleton.unit) for leg in legs]
    # A different foot height lifts or lowers the whole body once, instead of bending the knees.
    lift = np.median([move[:, 1] for move in moves])
    result[..., 1] += lift
    for leg, move in zip(legs, moves):
      bend_leg(source, result, leg, move, skeleton)
  result[..., 1] -= floor_height(result, skeleton)
  return result


def leg_scale(joints: Float[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> float:
  """Ratio of the skeleton's leg lengths (thigh and shin, both legs) to those of joints (T, J, 3)."""
  measured, length = 0.0, 0.0
  for chain in skeleton.chains[:2]:
    for parent, joint in zip(chain[1:3], chain[2:4]):
      measured += np.median(np.linalg.norm(joints[:, joint] - joints[:, parent], axis=-1))
      length += skeleton.bone_lengths[joint]
  if not measured > 0:
    raise ValueError("the legs have no length: all of hip, knee and ankle lie in one point; check the joint mapping")
  return length / measured


def floor_height(joints: Float[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> float | np.floating:
  """Floor height of joints (T, J, 3): the 5th percentile of the lower foot's height."""
  feet = list(skeleton.left_feet + skeleton.right_feet)
  return np.percentile(joints[:, feet, 1].min(1), _FLOOR_PERCENTILE)


def mirror(joints: Num[Array, "*lead j 3"], skeleton: Skeleton = HUMANML3D) -> Num[np.ndarray, "*lead j 3"]:
  """Mirror image of joints (..., J, 3): x negated, left and right joints exchanged."""
  return np.asarray(joints)[..., list(skeleton.mirror), :] * np.array([-1, 1, 1], np.asarray(joints).dtype)


def bend(start: Float[np.ndarray, "t 3"], end: Float[np.ndarray, "t 3"], side: Float[np.ndarray, "t 3"], upper: float,
         lower: float) -> Float[np.ndarray, "t 3"]:
  """The middle joint (T, 3) of a limb with bone lengths upper and lower, bent towards side.

  start, end, side: (T, 3); the caller keeps start and end within the limb's reach.
  """
  line = end - start
  distance = np.linalg.norm(line, axis=-1, keepdims=True)
  side = _across(side, line)
  side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-9)
  cosine = (upper**2 + distance**2 - lower**2) / np.maximum(2 * upper * distance, 1e-9)
  sine = np.sqrt(np.maximum(0, 1 - cosine**2))
  return start + upper * (cosine * line / np.maximum(distance, 1e-9) + sine * side)


def with_lengths(source: Float[A, "*lead t j 3"], skeleton: Skeleton) -> Float[A, "*lead t j 3"]:
  """Joints (..., T, J, 3) with the source's root and bone directions and the skeleton's bone lengths.

  A bone of no length continues the direction of the bone before it; the first of a limb has that of a T-pose.
  """
  xp: Any = rot.namespace(source)
  bones = source - source[..., np.maximum(skeleton.parents, 0), :]
  lengths = rot.length(bones)[..., None]
  known = lengths > _NO_LENGTH * skeleton.bone_lengths[list(skeleton.leg_bones)].sum()
  directions = bones / xp.maximum(lengths, 1e-9)
  joints = {skeleton.chains[0][0]: source[..., skeleton.chains[0][0], :]}
  axes = None
  for chain in skeleton.chains:
    direction = xp.zeros_like(bones[..., 0, :])
    first = chain[1]
    if skeleton.bone_lengths[first] > 0 and (xp is not np or not known[..., first, :].all()):
      axes = axes or body_axes(source, skeleton)
      rest = t_pose(skeleton)[first] / skeleton.bone_lengths[first]
      direction = axes[int(chain[0] == skeleton.chains[3][0])] @ xp.asarray(rest, bones.dtype)
    for parent, joint in zip(chain[:-1], chain[1:]):
      direction = xp.where(known[..., joint, :], directions[..., joint, :], direction)
      joints[joint] = (joints[parent] + direction * skeleton.bone_lengths[joint]).astype(source.dtype)
  return xp.stack([joints[joint] for joint in range(skeleton.num_joints)], axis=-2)


def foot_move(source: Float[np.ndarray, "t j 3"], result: Float[np.ndarray, "t j 3"], leg: Sequence[int], unit: float
               ) -> Float[np.ndarray, "t 3"]:
  """Offset (T, 3) of an ankle from the scaled source's that avoids sliding of both ankle and toes.

  A foot of another length cannot keep both. In height the toes are kept. On the ground the offset e solves
  min sum a |step of e|^2 + b |step of (e + g)|^2 + c |e + g / 2|^2, where g is the difference of foot lengths, a and b
  the firmness with which ankle and toes stand in the source, and a small c prevents drift.
  """
  from scipy.linalg import solveh_banded
  ankle, toes = leg[2], leg[-1]
  reach = (result[:, toes] - result[:, ankle]) - (source[:, toes] - source[:, ankle])
  move = -reach
  if len(source) < 3:
    return move
  firm_ankle, firm_toes = firmness(source[:, ankle], unit), firmness(source[:, toes], unit)
  pull = 1e-3
  steps = np.diff(reach[:, [0, 2]], axis=0) * firm_toes[:, None]
  both = firm_ankle + firm_toes
  diagonal = pull + np.append(both, 0) + np.append(0, both)
  banded = np.stack([np.append(0, -both), diagonal])
  pushed = np.zeros((len(source), 2))
  pushed[:-1] += steps
  pushed[1:] -= steps
  move[:, [0, 2]] = solveh_banded(banded, pushed - pull / 2 * reach[:, [0, 2]])
  return move


def firmness(path: Float[np.ndarray, "t 3"], unit: float) -> Float[np.ndarray, " t-1"]:
  """Firmness (T - 1,) with which a joint (T, 3) stands between frames: 1 when slow and low, near 0.02 in the air."""
  speed = np.linalg.norm(np.diff(path, axis=0), axis=-1) * unit
  height = (path[:, 1] - np.percentile(path[:, 1], _FLOOR_PERCENTILE)) * unit
  low = 1 / (1 + (np.maximum(height[:-1], height[1:]).clip(0) / 0.06) ** 4)
  return 0.02 + low / (1 + (speed / 0.02) ** 2)


def bend_leg(source: Float[np.ndarray, "t j 3"], result: Float[np.ndarray, "t j 3"], leg: Sequence[int],
             move: Float[np.ndarray, "t 3"], skeleton: Skeleton) -> None:
  """Moves knee, ankle and all joints below; the ankle reaches source + move as far as the leg allows. In place."""
  hip, knee, ankle = leg[:3]
  thigh, shin = skeleton.bone_lengths[knee], skeleton.bone_lengths[ankle]
  line = source[:, ankle] + move - result[:, hip]
  distance = np.linalg.norm(line, axis=-1)
  along = line / np.maximum(distance, 1e-9)[:, None]
  bones = [np.linalg.norm(source[:, a] - source[:, b], axis=-1) for a, b in ((knee, hip), (ankle, knee), (ankle, hip))]
  straight = np.clip(bones[2] / np.maximum(bones[0] + bones[1], 1e-9), _SOFT_REACH, 0.9999)
  distance = _soft_limit(distance, straight * (thigh + shin), thigh + shin)
  distance = np.clip(distance, 1.001 * abs(thigh - shin), 0.99999 * (thigh + shin))
  below = [result[:, joint] - result[:, ankle] for joint in leg[3:]]
  result[:, ankle] = result[:, hip] + distance[:, None] * along
  result[:, knee] = bend(result[:, hip], result[:, ankle], knee_side(source, leg, skeleton), thigh, shin)
  for joint, offset in zip(leg[3:], below):
    result[:, joint] = result[:, ankle] + offset


def knee_side(source: Float[np.ndarray, "*lead t j 3"], leg: Sequence[int], skeleton: Skeleton
              ) -> Float[np.ndarray, "*lead t 3"]:
  """Direction (..., T, 3) in which a knee points: off the line from hip to ankle, and ahead for straight legs."""
  hip, knee, ankle = leg[:3]
  off_line = _across(source[..., knee, :] - source[..., hip, :], source[..., ankle, :] - source[..., hip, :])
  return off_line + body_axes(source, skeleton)[0][..., 2] * _KNEE_BIAS / skeleton.unit


def _soft_limit(distance: Float[np.ndarray, " t"], start: Float[np.ndarray, " t"], reach: float
                ) -> Float[np.ndarray, " t"]:
  """Limits distances (T,) smoothly: unchanged up to start, then approaching reach."""
  over = np.maximum(distance - start, 0)
  return np.minimum(distance, start) + (reach - start) * -np.expm1(-over / (reach - start))


def _across(v: Float[np.ndarray, "*lead 3"], line: Float[np.ndarray, "*lead 3"]) -> Float[np.ndarray, "*lead 3"]:
  """The component of v (..., 3) perpendicular to line (T, 3)."""
  return v - line * ((v * line).sum(-1, keepdims=True) / np.maximum((line * line).sum(-1, keepdims=True), 1e-12))
