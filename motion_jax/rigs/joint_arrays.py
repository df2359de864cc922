"""Identify the skeleton of an array of joints without names, by the number of joints and the bone lengths."""
import dataclasses
import warnings
from typing import NamedTuple

import numpy as np

from motion_jax.motion import plausibility
from motion_jax.motion.skeleton import HUMANML3D, KIT, SNAPMOGEN, Skeleton
from motion_jax.rigs.joint_maps import map_joints
from motion_jax.shapes import Array, Num
from motion_jax.utils.errors import InputError

_HAND = 0.085  # metres from a wrist to SMPL's hand
_SMPL_24 = dataclasses.replace(
    HUMANML3D, name="SMPL's 22 joints and hands", joints=(*HUMANML3D.joints, "left_hand", "right_hand"),
    chains=(*HUMANML3D.chains[:3], (*HUMANML3D.chains[3], 23), (*HUMANML3D.chains[4], 22)),
    rest_directions=np.concatenate([HUMANML3D.rest_directions, HUMANML3D.rest_directions[20:]]),
    bone_lengths=np.append(HUMANML3D.bone_lengths, [_HAND, _HAND]))


class _Named(NamedTuple):
  """Joint order of a known file format: index of the first joint of trunk, arms and legs; joints follow in order."""
  name: str
  trunk: int
  left_arm: int
  right_arm: int
  left_leg: int
  right_leg: int

  def read(self, joints: Num[Array, "t n 3"]) -> Num[np.ndarray, "t j 3"]:
    parts = ((self.trunk, "Hips Spine1 Spine2 Chest Neck1 Neck2 Head", -1),
             *((start, " ".join(side + word for word in words.split()), parent) for start, words, parent, side in (
                 (self.left_arm, "Shoulder Arm ForeArm Hand", 3, "Left"),
                 (self.right_arm, "Shoulder Arm ForeArm Hand", 3, "Right"),
                 (self.left_leg, "Leg Shin Foot ToeBase", 0, "Left"),
                 (self.right_leg, "Leg Shin Foot ToeBase", 0, "Right"))))
    names: list[str] = []
    parents: list[int] = []
    columns: list[int] = []
    for start, words, parent in parts:
      for offset, word in enumerate(words.split()):
        parents.append(len(names) - 1 if offset else parent)
        names.append(word)
        columns.append(start + offset)
    return map_joints(names, joints[:, columns], parents=parents)[0]


# Kimodo's skeletons, nv-tlabs/kimodo:kimodo/skeleton/definitions.py
_SOMA = {77: _Named("SOMA's 77 joints", 0, 11, 39, 67, 72), 30: _Named("SOMA's 30 joints", 0, 10, 16, 22, 26)}
_BY_COUNT: dict[int, tuple[Skeleton, ...]] = {21: (KIT,), 22: (HUMANML3D,), 24: (SNAPMOGEN, _SMPL_24)}


def pick_joints(joints: Num[Array, "*shape"], name: str = "motion") -> tuple[Num[np.ndarray, "t j 3"], Skeleton]:
  """Selects the joints (T, J, 3) of a known skeleton from an array of any number of joints: (joints, skeleton).

  21 joints are KIT's, 22 HumanML3D's, 24 SnapMoGen's or SMPL's, depending on the bones. Of larger arrays the first 22
  joints are used if they form a body, as for SMPL-H (52) and SMPL-X (55); Kimodo's SOMA (77 and 30) is recognized by
  its order. Warns about omitted joints. Raises InputError for any other array.
  """
  joints = np.asarray(joints)
  count = joints.shape[1] if joints.ndim == 3 and joints.shape[2] == 3 else 0
  if count in _SOMA and len(joints) and not _oddness(joints[:, :22], HUMANML3D) <= plausibility.ODD:
    warnings.warn(f"{name}: {count} joints, read as {_SOMA[count].name}", stacklevel=2)
    return _SOMA[count].read(joints), HUMANML3D
  candidates = _BY_COUNT.get(count) or ((HUMANML3D,) if count > 22 else ())
  if not candidates or not len(joints):
    raise InputError(f"got an array of shape {joints.shape}, expected joints (frames, 22, 3) or (frames, 21, 3), or "
                     "features (frames, F)")
  skeleton = min(candidates, key=lambda candidate: _oddness(joints[:, :candidate.num_joints], candidate))
  if count == skeleton.num_joints and skeleton is not _SMPL_24:
    return joints, skeleton
  if not _oddness(joints[:, :skeleton.num_joints], skeleton) <= plausibility.ODD:
    raise InputError(f"got joints of shape {joints.shape}, the first 22 of which do not have SMPL's bones; expected "
                     f"(frames, 22, 3): {', '.join(HUMANML3D.joints)}")
  rest = "the hands" if count == 24 else "hands and face" if count > 24 else "the last"
  warnings.warn(f"{name}: {count} joints, of which the first 22 are SMPL's; {rest} are left out", stacklevel=2)
  return joints[:, :22], HUMANML3D


def _oddness(joints, skeleton):
  return plausibility.oddness(joints, skeleton) if np.isfinite(joints).all() else np.inf
