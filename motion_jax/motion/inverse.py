"""Inverse kinematics of whole bodies: rotations of a skeleton with a given rest pose, from joint positions alone.

Positions do not determine the twist of a bone. A joint with several children gets the rotation that fits them best, or
that of the body where they lie on one line; any other joint turns as little as possible from its parent. (`pose`
chooses anatomical twists, from a T-pose.)
"""
import dataclasses
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import THIN, Skeleton, body_axes, bone_lengths, from_nearest
from motion_jax.shapes import Float
from motion_jax.utils.lazy import jax


def world_rotations(joints: Float[A, "*lead t j 3"], skeleton: Skeleton) -> Float[A, "*lead t j 4"]:
  """World rotations, quaternions (..., T, J, 4), that bring the skeleton's bones at rest onto those of joints
  (..., T, J, 3)."""
  xp: Any = rot.namespace(joints)
  parents, offsets = skeleton.parents, skeleton.offsets
  bones = joints - joints[..., np.maximum(parents, 0), :]
  length = np.linalg.norm(offsets, axis=-1)
  # A joint that coincides with its parent (SnapMoGen's pelvis) turns with it, and its bones count as the parent's.
  holder = [j if j == 0 or length[j] > 1e-6 else parents[j] for j in range(skeleton.num_joints)]
  members = [[k for k in range(1, skeleton.num_joints) if length[k] > 1e-6 and holder[parents[k]] == j]
             for j in range(skeleton.num_joints)]
  none = xp.broadcast_to(xp.asarray([1.0, 0, 0, 0], joints.dtype), joints.shape[:-2] + (4,))
  turned: list = [None] * skeleton.num_joints
  for level in levels(skeleton):
    single = [joint for joint in level if holder[joint] == joint and len(members[joint]) == 1]
    for joint in set(level) - set(single):
      fits = holder[joint] == joint and members[joint]
      turned[joint] = turned[parents[joint]] if joint else none
      if fits:
        bend = bones[..., members[joint], :]
        turned[joint] = rot.from_matrix(_fit(joints, bend, offsets[members[joint]], joint, skeleton))
    if single:
      children = [members[joint][0] for joint in single]
      above = xp.stack([turned[parents[joint]] if joint else none for joint in single], axis=-2)
      now = rot.rotate(above, xp.asarray(skeleton.rest_directions[children], joints.dtype))
      bone = bones[..., children, :]
      size = rot.length(bone)[..., None]
      bone = xp.where(size > 1e-9, bone / xp.maximum(size, 1e-9), now)  # a bone of no length turns with its parent
      for index, q in enumerate(xp.moveaxis(rot.multiply(rot.between(now, bone), above), -2, 0)):
        turned[single[index]] = q
  return rot.unit(xp.stack(turned, axis=-2))


def _fit(joints: Float[A, "*lead t j 3"], bones: Float[A, "*lead t n 3"], shape: Float[np.ndarray, "n 3"],
         joint: int, skeleton: Skeleton) -> Float[A, "*lead t 3 3"]:
  """Rotations (..., T, 3, 3) of a joint that fit its child bones; the body's axes where these do not span a plane."""
  xp: Any = rot.namespace(joints)
  thin = THIN * xp.median(bone_lengths(joints, skeleton)[..., list(skeleton.leg_bones)].sum(-1), axis=-1)
  spread = xp.linalg.svd(bones if xp is np else jax.lax.stop_gradient(bones), compute_uv=False)[..., 1]
  by_bones = xp.median(spread, axis=-1) > thin
  if xp is np and by_bones.all():
    return from_nearest(rot.best_turn(bones, shape), spread > 1e-6 * thin)
  rest = np.zeros((1, skeleton.num_joints, 3))
  for child in skeleton.order[1:]:
    rest[:, child] = rest[:, skeleton.parents[child]] + skeleton.offsets[child]
  part = int(joint == skeleton.chains[3][0])
  by_body = body_axes(joints, skeleton)[part] @ xp.asarray(body_axes(rest, skeleton)[part][0].T, joints.dtype)
  if xp is np:
    return by_body
  fitted = from_nearest(rot.best_turn(bones, shape), spread > 1e-6 * thin[..., None])
  return xp.where(by_bones[..., None, None, None], fitted, by_body)


def relative(turned: Float[A, "*lead j 4"], skeleton: Skeleton) -> Float[A, "*lead j 4"]:
  """Rotations relative to the parents, of world rotations (..., J, 4); the root's stays."""
  parents = np.maximum(skeleton.parents, 0)
  local = rot.multiply(rot.conjugate(turned[..., parents, :]), turned)
  return rot.namespace(turned).concatenate([turned[..., :1, :], local[..., 1:, :]], axis=-2)


def forward(root: Float[np.ndarray, "t 3"], turned: Float[np.ndarray, "t j 4"], skeleton: Skeleton
            ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) of a root path (T, 3) and world rotations (T, J, 4) with the skeleton's own offsets."""
  joints = np.empty(turned.shape[:2] + (3,))
  joints[:, 0] = root
  for joint in skeleton.order[1:]:
    parent = skeleton.parents[joint]
    joints[:, joint] = joints[:, parent] + rot.rotate(turned[:, parent], skeleton.offsets[joint])
  return joints


def with_rest(skeleton: Skeleton, offsets: Float[np.ndarray, "j 3"]) -> Skeleton:
  """The same tree with the rest pose of offsets (J, 3)."""
  lengths = np.linalg.norm(offsets, axis=-1)
  directions = offsets / np.maximum(lengths, 1e-12)[:, None]
  return dataclasses.replace(skeleton, rest_directions=directions, bone_lengths=lengths)


def levels(skeleton: Skeleton) -> list[list[int]]:
  """Joints grouped by depth in the tree: [[root], its children, their children, ...]."""
  by_depth = [[0]]
  while below := [k for k, parent in enumerate(skeleton.parents) if parent in by_depth[-1]]:
    by_depth.append(below)
  return by_depth

