"""Rotations of a skeleton whose rest pose is given, from joint positions alone: for data that holds no rotations.

Positions do not show how a bone is turned about itself: a joint with several children gets the turn that fits them
best, any other turns as little as possible from its parent. (`pose` chooses turns as a body would, from a T-pose of its
own.)
"""
import dataclasses

import numpy as np
from jaxtyping import Float

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import Skeleton


def world_rotations(joints: Float[np.ndarray, "t j 3"], skeleton: Skeleton) -> Float[np.ndarray, "t j 4"]:
  """World rotations, quaternions (T, J, 4), that bring the skeleton's bones at rest onto those of joints (T, J, 3)."""
  parents, offsets = skeleton.parents, skeleton.offsets
  bones = joints - joints[:, np.maximum(parents, 0)]
  length = np.linalg.norm(offsets, axis=-1)
  # A joint in its parent's place (SnapMoGen's pelvis) turns with it, and its bones count as the parent's.
  holder = [j if j == 0 or length[j] > 1e-6 else parents[j] for j in range(skeleton.num_joints)]
  members = [[k for k in range(1, skeleton.num_joints) if length[k] > 1e-6 and holder[parents[k]] == j]
             for j in range(skeleton.num_joints)]
  turned: list = [None] * skeleton.num_joints
  for joint in order(skeleton):
    above = turned[parents[joint]] if joint else np.tile([1.0, 0, 0, 0], (len(joints), 1))
    below = members[joint]
    if holder[joint] != joint or not below:
      turned[joint] = above
    elif len(below) == 1:
      now = rot.rotate(above, skeleton.rest_directions[below[0]])
      turned[joint] = rot.multiply(rot.between(now, rot.unit(bones[:, below[0]])), above)
    else:
      turned[joint] = rot.from_matrix(rot.best_turn(bones[:, below], offsets[below]))
  return rot.unit(np.stack(turned, axis=1))


def relative(turned: Float[np.ndarray, "t j 4"], skeleton: Skeleton) -> Float[np.ndarray, "t j 4"]:
  """World rotations (T, J, 4) to rotations relative to the parents; the root's stays."""
  parents = np.maximum(skeleton.parents, 0)
  local = rot.multiply(rot.conjugate(turned[:, parents]), turned)
  return np.concatenate([turned[:, :1], local[:, 1:]], axis=1)


def forward(root: Float[np.ndarray, "t 3"], turned: Float[np.ndarray, "t j 4"], skeleton: Skeleton
            ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) of a root path (T, 3) and world rotations (T, J, 4) with the skeleton's own offsets."""
  joints = np.empty(turned.shape[:2] + (3,))
  joints[:, 0] = root
  for joint in order(skeleton)[1:]:
    parent = skeleton.parents[joint]
    joints[:, joint] = joints[:, parent] + rot.rotate(turned[:, parent], skeleton.offsets[joint])
  return joints


def with_rest(skeleton: Skeleton, offsets: Float[np.ndarray, "j 3"]) -> Skeleton:
  """The same tree with the rest pose of offsets (J, 3)."""
  lengths = np.linalg.norm(offsets, axis=-1)
  directions = offsets / np.maximum(lengths, 1e-12)[:, None]
  return dataclasses.replace(skeleton, rest_directions=directions, bone_lengths=lengths)


def order(skeleton: Skeleton) -> list[int]:
  """Joints, parents before children."""
  found = [0]
  for joint in found:
    found += [k for k, parent in enumerate(skeleton.parents) if parent == joint]
  return found
