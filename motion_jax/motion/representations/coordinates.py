"""Coordinates: the joints themselves, 66 numbers a frame, KIT's 63.

Joints are brought to the form that the full features of the same skeleton decode to: its bone lengths, starting at the
origin, facing +z, one row less than frames. Each row depends on its frame alone.
"""
import dataclasses
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.representations.base import VECTOR, Block, Representation
from motion_jax.motion.representations.humanml3d import FULL, FULL_KIT, HumanML3D
from motion_jax.motion.rotations import A
from motion_jax.shapes import Float, Num
from motion_jax.utils.lazy import is_jax


@dataclasses.dataclass(frozen=True, eq=False)
class Coordinates(Representation):
  """Joints as features. full: the representation that brings joints onto the skeleton's bones and to the origin."""
  full: HumanML3D

  are_joints = True
  joints_suffice = True
  std_by_block = False
  has_fixed_bones = True

  def extract(self, joints: Float[A, "*lead t j 3"], mode: str) -> Float[A, "*lead _ f"]:
    return self.of_joints(self.full.to_joints(self.full.from_joints(joints, mode)))

  def from_joints_in_place(self, joints: Num[A, "*lead t j 3"], mode: str = "benchmark") -> Float[A, "*lead t f"]:
    rows: Any = self.of_joints(joints)
    return rows if is_jax(joints) else rows.astype(np.float32)

  def of_joints(self, joints: Num[A, "*lead t j 3"]) -> Num[A, "*lead t f"]:
    return joints.reshape(joints.shape[:-2] + (self.dim,))

  def recover(self, features: Num[A, "*lead t f"]) -> Num[A, "*lead t j 3"]:
    return features.reshape(features.shape[:-1] + (self.skeleton.num_joints, 3))

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    xp = rot.namespace(features)
    joints = self.to_joints(features.astype(np.float64) if xp is np else features)
    (right_hip, left_hip), (right_shoulder, left_shoulder) = self.skeleton.hips, self.skeleton.shoulders
    left = joints[..., left_hip, :] - joints[..., right_hip, :] + (
        joints[..., left_shoulder, :] - joints[..., right_shoulder, :])
    return rot.about_axis(rot.arctan2(left[..., 2], left[..., 0]), "y"), joints[..., 0, :]


COORDINATES, COORDINATES_KIT = (
    Coordinates(name, full.skeleton, {"coordinates": Block(VECTOR, tuple(range(full.skeleton.num_joints)))}, full)
    for name, full in (("coordinates", FULL), ("coordinates_kit", FULL_KIT)))
