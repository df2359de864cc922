"""Combine two motions in one body: arms, head or torso of one on the rest of the other."""
from collections.abc import Sequence

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import to_pose
from motion_jax.motion.skeleton import Skeleton, facing
from motion_jax.shapes import Float, Num

_ONE_SIDED = 2.0  # how many times farther than the other a hand travels if only one of them acts


def put_on(base: Num[np.ndarray, "t j 3"], other: Num[np.ndarray, "t j 3"], part: str, sides: Sequence[str],
           weight: Num[np.ndarray, " t"], skeleton: Skeleton, upright: bool = False) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) of base with one body part of other, oriented relative to the chest (torso: the pelvis). float32.

  part: "arms", "head" or "torso", which includes head and arms. sides: "left", "right" or both arms; by default the
  arm that acts, or both if both do. weight (T,): 0 is base, 1 is other. upright: arms are oriented relative to the
  direction that the body faces, however much its chest leans, so that a raised hand goes up; shoulders stay base's.
  Only bone directions change, so bones keep base's lengths; joints of other parts, such as feet, do not move.
  """
  base, other = np.asarray(base, np.float64), np.asarray(other, np.float64)
  _, _, back, right, left = skeleton.chains
  chest = right[0]
  head = back[back.index(chest):]
  if part == "arms" and not sides:
    sides = acting(other, skeleton)
  arms = [chain for side, chain in (("right", right), ("left", left)) if part == "torso" or side in sides]
  chains = {"arms": arms, "head": [head], "torso": [back, *arms]}[part]
  anchor = back[0] if part == "torso" else chest
  ours, theirs = (to_pose(joints, skeleton).turned[:, anchor] for joints in (base, other))
  turn = rot.multiply(ours, rot.conjugate(theirs))
  if upright and part == "arms":
    turn = rot.between(facing(other, skeleton), facing(base, skeleton))
    chains = [chain[2:] for chain in chains]  # from the shoulder on
  result = base.copy()
  for chain in chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      bone, goal = base[:, joint] - base[:, parent], rot.rotate(turn, other[:, joint] - other[:, parent])
      result[:, joint] = result[:, parent] + turned_towards(bone, goal, weight)
  return result.astype(np.float32)


def acting(joints: Num[np.ndarray, "t j 3"], skeleton: Skeleton) -> tuple[str, ...]:
  """Sides of the acting hands: the one that travels over twice as far, relative to the chest, as the other; or both."""
  _, _, _, right, left = skeleton.chains
  turned = to_pose(joints, skeleton).turned[:, right[0]]
  way = {}
  for side, chain in (("left", left), ("right", right)):
    held = rot.rotate(rot.conjugate(turned), np.asarray(joints[:, chain[-1]] - joints[:, chain[0]], np.float64))
    way[side] = np.linalg.norm(np.diff(held, axis=0), axis=-1).sum()
  sides = tuple(side for side, other in (("left", "right"), ("right", "left")) if way[side] > way[other] / _ONE_SIDED)
  return sides or ("left", "right")


def turned_towards(vector: Float[np.ndarray, "t 3"], goal: Float[np.ndarray, "t 3"], weight: Num[np.ndarray, " t"]
                   ) -> Float[np.ndarray, "t 3"]:
  """Vectors (T, 3), turned towards goal (T, 3) by weight (T,) of the angle between the two; lengths stay."""
  length = np.linalg.norm(vector, axis=-1, keepdims=True)
  safe = np.where(length > 1e-9, vector, [0.0, 1.0, 0.0])
  whole = rot.between(safe, np.where(np.linalg.norm(goal, axis=-1, keepdims=True) > 1e-9, goal, safe))
  still = np.broadcast_to([1.0, 0.0, 0.0, 0.0], whole.shape)
  return rot.rotate(rot.slerp(still, whole, np.asarray(weight, np.float64)), safe) * (length > 1e-9)
