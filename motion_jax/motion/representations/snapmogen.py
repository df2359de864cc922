"""SnapMoGen's features: 296 numbers a frame, 24 joints, 30 frames a second, centimetres.

Source: docs/papers/cdamd.md#snapmogen-features.

  columns   block          row t, made of frames t and t + 1
  0         turn           radians that the heading turns until the next frame (the full angle, not half of it)
  1:3       root_velocity  x and z of the root's step to the next frame, turned by the heading of frame t
  3         root_height    centimetres over the floor
  4:148     rotations      24 x 6: rotation in the world with the heading taken out, root included; first two columns
  148:220   positions      24 x 3: root's x and z and the heading taken out; joint 0 is (0, height, 0)
  220:292   velocities     24 x 3: positions of the next row minus these
  292:296   contacts       left ankle, left toes, right ankle, right toes stand: 0 or 1

Columns 0:148 are what SnapMoGen's evaluator sees (layout "snapmogen_148"): joints come back from the rotations.

Modes: "benchmark" is `motion_process_bvh.py` of snap-research/SnapMoGen. "corrected" differs in two things: the turn,
which the reference writes 2 pi too large or too small in the row where the source's heading passes -z, and the
smoothing of the heading, which there depends a little on where the source faces. Both come back to joints exactly.
"""
from typing import Any

import numpy as np

from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations.base import GROUND, ROTATION, VECTOR, Block, Representation, join_rows
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import SNAPMOGEN
from motion_jax.motion.smoothing import gaussian
from motion_jax.shapes import Array, Float, Num

_SMOOTH = 5.0                       # sigma of the heading, frames
_STAND_HEIGHT = np.array([9.0, 4.0])  # centimetres under which ankle and toes can stand


class SnapMoGen(Representation):
  """All 296 columns, or the evaluator's 148."""

  def extract(self, joints: Float[A, "*lead t 24 3"], mode: str) -> Float[A, "*lead _ 296"]:
    """Features with the rotations of least twist that fit these joints; `from_rotations` takes those of a file."""
    return from_rotations(joints, inverse.world_rotations(joints, SNAPMOGEN), mode)

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    """Heading quaternions (..., T, 4) and root positions (..., T, 3) of the first four columns."""
    # Parity: the released code turns a step by its final heading, though its extraction uses the initial one: a walk
    # along a curve is restored with an error of about one frame's turn.
    xp = rot.namespace(features)
    if xp is np:
      features = features.astype(np.float64)
    late = lambda a: xp.concatenate([xp.zeros_like(a[..., :1, :]), a[..., :-1, :]], axis=-2)
    heading = rot.about_axis(xp.cumsum(late(features[..., :1])[..., 0], axis=-1), "y")
    step = xp.stack([features[..., 1], xp.zeros_like(features[..., 1]), features[..., 2]], axis=-1)
    path = late(xp.cumsum(rot.rotate(rot.conjugate(heading), step), axis=-2))
    return heading, xp.stack([path[..., 0], features[..., 3], path[..., 2]], axis=-1)

  def recover(self, features: Num[A, "*lead t f"]) -> Float[A, "*lead t 24 3"]:
    """Joints from the position columns; from 148 columns by the rotations."""
    if "positions" not in self.blocks:
      return self.rotations_to_joints(features)
    local = features[..., self["positions"]].reshape(features.shape[:-1] + (24, 3))
    return _place(local, *self.root_path(features))

  def rotations_to_joints(self, features: Num[A, "*lead t f"], offsets: Num[Array, "24 3"] | None = None,
                          mode: str = "benchmark") -> Float[A, "*lead t 24 3"]:
    self.check(features)
    xp = rot.namespace(features)
    heading, root = self.root_path(features)
    turned = rot.matrix_from_6d(features[..., self["rotations"]].reshape(features.shape[:-1] + (24, 6)))
    offsets = xp.asarray(SNAPMOGEN.offsets if offsets is None else offsets, root.dtype)
    local = [root * xp.asarray([0, 1, 0], root.dtype)]
    for joint, parent in enumerate(SNAPMOGEN.parents[1:], 1):
      local.append(local[parent] + turned[..., parent, :, :] @ offsets[joint])
    return _place(xp.stack(local, axis=-2), heading, root)


def from_rotations(joints: Num[A, "*lead t 24 3"], turned: Float[A, "*lead t 24 4"], mode: str = "benchmark"
                   ) -> Float[A, "*lead t-1 296"]:
  """Features (..., T - 1, 296) of joints (..., T, 24, 3) in centimetres and their world rotations, quaternions
  (..., T, 24, 4); numpy gives float64. Neither place nor heading of the first frame matters."""
  xp = rot.namespace(joints, turned)
  feet = list(SNAPMOGEN.left_feet + SNAPMOGEN.right_feet)
  ground: Any = floor(joints[..., feet, 1])
  joints = joints.astype(np.float64) if xp is np else joints
  joints = xp.stack([joints[..., 0], joints[..., 1] - ground[..., None, None], joints[..., 2]], axis=-1)
  heading = _heading(joints, mode)
  now = heading[..., :, None, :]
  local = rot.rotate(now, joints - joints[..., :1, :] * xp.asarray([1, 0, 1], joints.dtype))
  turn = rot.multiply(heading[..., 1:, :], rot.conjugate(heading[..., :-1, :]))
  turn = 2 * xp.arctan2(turn[..., 2], turn[..., 0])
  if mode == "corrected":
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
  # Parity: here the step is turned by the heading it begins with, in HumanML3D's features by that it ends with.
  step = rot.rotate(heading[..., :-1, :], xp.diff(joints[..., 0, :], axis=-2))[..., [0, 2]]
  still = (xp.diff(joints[..., feet, :], axis=-3) ** 2).sum(-1) < SNAPMOGEN.contact_threshold
  contacts = still & (joints[..., :-1, feet, 1] < np.tile(_STAND_HEIGHT, 2))
  rotations = rot.to_6d(rot.multiply(now, turned))[..., :-1, :, :]
  rows = (turn, step, local[..., :-1, 0, 1], rotations, local[..., :-1, :, :], xp.diff(local, axis=-3), contacts)
  return join_rows(rows, turn)


def floor(heights: Num[A, "*lead t 4"]) -> Num[Array | np.floating, "*lead"]:
  """Floor height under feet of heights (..., T, 4): the mean of their lowest tenth."""
  lowest = rot.namespace(heights).sort(heights.reshape(heights.shape[:-2] + (-1,)), axis=-1)
  return lowest[..., :max(1, int(lowest.shape[-1] * 0.1))].mean(-1)


def _heading(joints, mode):
  """Quaternions (..., T, 4) that turn the facing direction of each frame to +z."""
  xp = rot.namespace(joints)
  (right_hip, left_hip), (right_shoulder, left_shoulder) = SNAPMOGEN.hips, SNAPMOGEN.shoulders
  across = joints[..., left_shoulder, :] - joints[..., right_shoulder, :] + joints[..., left_hip, :]
  across = across - joints[..., right_hip, :]
  # Parity: the reference divides by the sum of absolute components, not by the length: frames then weigh differently in
  # the smoothing, by where they face in the world.
  if mode == "corrected":
    across = rot.unit(across)
  else:
    size = abs(across).sum(-1, keepdims=True)
    across = across / (size if xp is np else xp.where(size == 0, 1, size))
  ahead = xp.cross(across, xp.asarray([0.0, 1.0, 0.0], across.dtype))
  ahead = rot.unit(gaussian(ahead, _SMOOTH))
  if mode == "corrected":
    return rot.about_axis(-rot.arctan2(ahead[..., 0], ahead[..., 2]), "y")
  return rot.between(ahead, xp.broadcast_to(xp.asarray([0.0, 0.0, 1.0], ahead.dtype), ahead.shape))


def _place(local, heading, root):
  """Joints with heading (..., T, 4) and root path (..., T, 3), of local joints (..., T, J, 3)."""
  xp = rot.namespace(local, root)
  around = root * xp.asarray([1, 0, 1], root.dtype)
  joints = rot.rotate(rot.conjugate(heading)[..., None, :], local) + around[..., None, :]
  return joints.astype(np.float32) if xp is np else joints

_ALL = tuple(range(24))
_EVALUATED = {"turn": Block((-1,)), "root_velocity": Block(GROUND), "root_height": Block((1,)),
              "rotations": Block(ROTATION, _ALL)}
SNAPMOGEN_296 = SnapMoGen("snapmogen", SNAPMOGEN, _EVALUATED | {
    "positions": Block(VECTOR, _ALL), "velocities": Block(VECTOR, _ALL),
    "contacts": Block((1,), SNAPMOGEN.left_feet + SNAPMOGEN.right_feet)})
SNAPMOGEN_148 = SnapMoGen("snapmogen_148", SNAPMOGEN, _EVALUATED)
