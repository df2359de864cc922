"""Rotations of a skeleton whose rest pose is given, from joint positions alone: for data that holds no rotations.

Positions do not show how a bone is turned about itself: a joint with several children gets the turn that fits them
best, or that of the body where they lie on one line; any other turns as little as possible from its parent. (`pose`
chooses turns as a body would, from a T-pose of its own.)
"""
import dataclasses

import numpy as np
from jaxtyping import Float

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import THIN, Skeleton, body_axes, bone_lengths, from_nearest


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
      now, bone = rot.rotate(above, skeleton.rest_directions[below[0]]), bones[:, below[0]]
      size = np.linalg.norm(bone, axis=-1, keepdims=True)
      bone = np.where(size > 1e-9, bone / np.maximum(size, 1e-9), now)  # a bone of no length turns with its parent
      turned[joint] = rot.multiply(rot.between(now, bone), above)
    else:
      turned[joint] = rot.from_matrix(_fit(joints, bones[:, below], offsets[below], joint, skeleton))
  return rot.unit(np.stack(turned, axis=1))


def _fit(joints: Float[np.ndarray, "t j 3"], bones: Float[np.ndarray, "t n 3"], shape: Float[np.ndarray, "n 3"],
         joint: int, skeleton: Skeleton) -> Float[np.ndarray, "t 3 3"]:
  """The turns (T, 3, 3) of a joint by the bones below it; by the body's axes where these do not span a plane."""
  thin = THIN * np.median(bone_lengths(joints, skeleton)[:, list(skeleton.leg_bones)].sum(-1))
  spread = np.linalg.svd(bones, compute_uv=False)[:, 1]
  if np.median(spread) > thin:
    return from_nearest(rot.best_turn(bones, shape), spread > 1e-6 * thin)
  rest = np.zeros((1, skeleton.num_joints, 3))
  for child in order(skeleton)[1:]:
    rest[:, child] = rest[:, skeleton.parents[child]] + skeleton.offsets[child]
  part = int(joint == skeleton.chains[3][0])
  return body_axes(joints, skeleton)[part] @ body_axes(rest, skeleton)[part][0].T


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
