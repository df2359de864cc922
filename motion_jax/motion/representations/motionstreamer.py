"""MotionStreamer's features: 272 numbers a frame, 22 SMPL joints, 30 frames a second, metres.

Source: docs/papers/cdamd.md#motionstreamer-features.

  columns   block          row t of T, made of frames t - 1 and t
  0:2       root_velocity  x and z of the root's step from the frame before, turned by that frame's heading; row 0: 0
  2:8       turn           rotation of the heading since the frame before; row 0: none
  8:74      positions      22 x 3: root's x and z and the heading taken out
  74:140    velocities     22 x 3: positions minus those of the row before; row 0: 0
  140:272   rotations      22 x 6: SMPL's rotations relative to the parent, the root's with the heading taken out

Rotations are the first two ROWS of their matrix (HumanML3D's are columns). The heading is that of the root's rotation,
not of hips and shoulders. Rows depend on the frame before: T frames make T rows, and joints are restored exactly.
"""
import numpy as np

from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations.base import GROUND, ROTATION, VECTOR, Block, Representation, join_rows
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import SMPL
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.lazy import is_jax, jax, jnp


class MotionStreamer(Representation):

  def extract(self, joints: Float[A, "*lead t 22 3"], mode: str) -> Float[A, "*lead _ 272"]:
    """Features with the rotations of least twist that fit these joints; `from_rotations` takes those of a file."""
    return from_rotations(joints, inverse.relative(inverse.world_rotations(joints, SMPL), SMPL))

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    xp = rot.namespace(features)
    if xp is np:
      features = features.astype(np.float64)
    heading = rot.from_matrix(_products(matrix_from_rows(features[..., self["turn"]])))
    step = xp.stack([features[..., 0], xp.zeros_like(features[..., 0]), features[..., 1]], axis=-1)
    turned = rot.rotate(rot.conjugate(heading[..., :-1, :]), step[..., 1:, :])
    path = xp.cumsum(xp.concatenate([step[..., :1, :], turned], axis=-2), axis=-2)
    return heading, xp.stack([path[..., 0], features[..., 9], path[..., 2]], axis=-1)

  def recover(self, features: Num[A, "*lead t f"]) -> Float[A, "*lead t 22 3"]:
    """Joints from the position columns."""
    xp = rot.namespace(features)
    heading, root = self.root_path(features)
    local = features[..., self["positions"]].reshape(features.shape[:-1] + (22, 3))
    around = xp.stack([root[..., 0], xp.zeros_like(root[..., 0]), root[..., 2]], axis=-1)
    joints = rot.rotate(rot.conjugate(heading)[..., None, :], local) + around[..., None, :]
    return joints.astype(np.float32) if xp is np else joints

  def rotations_to_joints(self, features: Num[A, "*lead t f"], offsets: Num[Array, "22 3"] | None = None,
                          mode: str = "benchmark") -> Float[A, "*lead t 22 3"]:
    self.check(features)
    heading, root = self.root_path(features)
    local = matrix_from_rows(features[..., self["rotations"]].reshape(features.shape[:-1] + (22, 6)))
    base = rot.to_matrix(rot.conjugate(heading)) @ local[..., 0, :, :]
    return smpl_joints(root, base, local, offsets)


def from_rotations(joints: Num[A, "*lead t 22 3"], rotations: Float[A, "*lead t 22 4"]) -> Float[A, "*lead t 272"]:
  """Features (..., T, 272) of joints (..., T, 22, 3) in metres, y up, and rotations relative to the parents,
  quaternions (..., T, 22, 4), the root's in the world; numpy gives float64. Neither place nor heading of the first
  frame matters."""
  xp = rot.namespace(joints, rotations)
  root = rot.to_matrix(rotations[..., 0, :])
  heading = rot.about_axis(-rot.arctan2(root[..., 0, 2], root[..., 2, 2]), "y")
  low = joints[..., 1].min((-2, -1), keepdims=True)
  joints = joints.astype(np.float64) if xp is np else joints
  joints = xp.stack([joints[..., 0], joints[..., 1] - low, joints[..., 2]], axis=-1)
  positions = rot.rotate(heading[..., None, :], joints - joints[..., :1, :] * xp.asarray([1, 0, 1], joints.dtype))
  from_before = lambda rows: xp.concatenate([xp.zeros_like(rows[..., :1, :, :]), rows], axis=-3)
  step = from_before(rot.rotate(heading[..., :-1, :], xp.diff(joints[..., 0, :], axis=-2))[..., None, :])
  turn = rot.multiply(heading[..., 1:, :], rot.conjugate(heading[..., :-1, :]))
  none = xp.broadcast_to(xp.asarray([1.0, 0, 0, 0], turn.dtype), heading[..., :1, :].shape)
  velocities = from_before(xp.diff(positions, axis=-3))
  upright = rot.multiply(heading, rotations[..., 0, :])
  local = xp.concatenate([upright[..., None, :], rotations[..., 1:, :]], axis=-2)
  rows = (step[..., 0, [0, 2]], to_rows(xp.concatenate([none, turn], axis=-2)), positions, velocities, to_rows(local))
  return join_rows(rows, joints[..., 0, 1])


def to_rows(q: Float[A, "*lead 4"]) -> Float[A, "*lead 6"]:
  """Quaternions (..., 4) to the first row, then the second row of their matrix, (..., 6)."""
  return rot.to_matrix(q)[..., :2, :].reshape(q.shape[:-1] + (6,))


def matrix_from_rows(d: Num[A, "*lead 6"]) -> Float[A, "*lead 3 3"]:
  """Two rows (..., 6), not necessarily orthonormal, to matrices (..., 3, 3) by Gram-Schmidt."""
  return rot.matrix_from_6d(d).swapaxes(-1, -2)


def _products(turns):
  """Cumulative products of rotation matrices (..., T, 3, 3), the latest on the left."""
  # Parity: full matrices are multiplied, as in the reference; a tilt in the features of a network accumulates.
  if is_jax(turns):
    step = lambda before, turn: (turn @ before,) * 2
    start = jnp.broadcast_to(jnp.eye(3, dtype=turns.dtype), turns.shape[:-3] + (3, 3))
    return jnp.moveaxis(jax.lax.scan(step, start, jnp.moveaxis(turns, -3, 0))[1], 0, -3)
  result = turns.copy()
  for t in range(1, turns.shape[-3]):
    result[..., t, :, :] = turns[..., t, :, :] @ result[..., t - 1, :, :]
  return result


def smpl_joints(root: Float[A, "*lead t 3"], base: Float[A, "*lead t 3 3"], local: Float[A, "*lead t 22 3 3"],
                offsets: Num[Array, "22 3"] | None = None) -> Float[A, "*lead t 22 3"]:
  """Forward kinematics of SMPL's tree: root (..., T, 3), its rotation base (..., T, 3, 3), rotations relative to the
  parents local (..., T, 22, 3, 3), of which the first is not used -> joints (..., T, 22, 3)."""
  xp = rot.namespace(root, local)
  offsets = xp.asarray(SMPL.offsets if offsets is None else offsets, root.dtype)
  turned, joints = [base], [root]
  for joint, parent in enumerate(SMPL.parents[1:], 1):
    joints.append(joints[parent] + turned[parent] @ offsets[joint])
    turned.append(turned[parent] @ local[..., joint, :, :])
  joints = xp.stack(joints, axis=-2)
  return joints.astype(np.float32) if xp is np else joints

_ALL = tuple(range(22))
MOTIONSTREAMER = MotionStreamer("motionstreamer", SMPL, {
    "root_velocity": Block(GROUND), "turn": Block(ROTATION), "positions": Block(VECTOR, _ALL),
    "velocities": Block(VECTOR, _ALL), "rotations": Block(ROTATION, _ALL)})
