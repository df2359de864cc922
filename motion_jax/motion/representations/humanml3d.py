"""HumanML3D's features and KIT's: 263 and 251 numbers a frame, or the first 67 and 64 of them.

All blocks are in the body's frame of reference (J joints: 22 in metres at 20 frames a second, KIT's 21 in millimetres
at 12.5):

  block          numbers      row t, made of frames t and t + 1
  turn           1            half the angle in radians that the heading turns until the next frame
  root_velocity  2            x and z of the root's step to the next frame, turned by that frame's heading
  root_height    1            over the floor
  positions      3 (J - 1)    the root's x and z and the heading taken out
  rotations      6 (J - 1)    of each bone from its rest direction, relative to the bone before; first two columns
  velocities     3 J          the step to the next frame, with the heading taken out
  contacts       4            left ankle, left toes, right ankle, right toes stand: 0 or 1

"essential" features, which CMDM and MARDM learn, end before the rotations.

Two modes make full features from joints:

- "benchmark" follows HumanML3D's `motion_representation.ipynb` bug for bug, so that numbers compare with the
  literature (docs/papers/cdamd.md#features): hips and shoulders enter the heading with opposite signs; the heading of
  frame 0 is overwritten by the identity; the turn has the wrong sign in a row where the heading passes 180 degrees; an
  arm's first rotation is relative to the root.
- "corrected" mends these four: equal signs, frame 0 turned to +z by its smoothed heading, turns by the wrapped angle,
  an arm's first rotation relative to the spine. Joints are restored exactly.
"""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import base
from motion_jax.motion.representations.base import GROUND, ROTATION, VECTOR, Block
from motion_jax.motion.retarget import retarget, with_lengths
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import HUMANML3D, KIT, Skeleton, bone_lengths, facing
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.lazy import is_jax, jnp

_AHEAD = np.array([0.0, 0.0, 1.0])


class HumanML3D(base.Representation):
  """Full features, or the essential ones, their first blocks."""
  has_fixed_bones = True

  def extract(self, joints: Float[A, "*lead t j 3"], mode: str) -> Float[A, "*lead _ f"]:
    return extract(canonicalize(joints, self.skeleton, mode), self.skeleton, mode)

  def from_joints_in_place(self, joints: Num[A, "*lead t j 3"], mode: str = "benchmark") -> Float[A, "*lead t f"]:
    features = extract(base.one_ahead(joints), self.skeleton, mode)[..., :self.dim]
    return features.astype(np.float32) if isinstance(features, np.ndarray) else features

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    xp = rot.namespace(features)
    if xp is np:
      features = features.astype(np.float64)
    late = lambda a: xp.concatenate([xp.zeros_like(a[..., :1]), a[..., :-1]], axis=-1)  # a value acts one frame on
    angle = xp.cumsum(late(features[..., 0]), axis=-1)
    heading = rot.about_axis(2 * angle, "y")
    zero = xp.zeros_like(angle)
    step = xp.stack([late(features[..., 1]), zero, late(features[..., 2])], axis=-1)
    path = xp.cumsum(rot.rotate(rot.conjugate(heading), step), axis=-2)
    return heading, xp.stack([path[..., 0], features[..., 3], path[..., 2]], axis=-1)

  def recover(self, features: Num[A, "*lead t f"]) -> Float[A, "*lead t j 3"]:
    """Joints from the position columns (docs/papers/cdamd.md#features)."""
    xp = rot.namespace(features)
    heading, root = self.root_path(features)
    local = features[..., self["positions"]].reshape(features.shape[:-1] + (self.skeleton.num_joints - 1, 3))
    turned = rot.rotate(rot.conjugate(heading)[..., None, :], local)
    around = xp.stack([root[..., 0], xp.zeros_like(root[..., 0]), root[..., 2]], axis=-1)
    joints = xp.concatenate([root[..., None, :], turned + around[..., None, :]], axis=-2)
    return joints.astype(np.float32) if xp is np else joints

  def rotations_to_joints(self, features: Num[A, "*lead t f"], offsets: Num[Array, "j 3"] | None = None,
                          mode: str = "benchmark") -> Float[A, "*lead t j 3"]:
    base.check_mode(mode)
    self.check(features)
    skeleton = self.skeleton
    offsets = skeleton.offsets if offsets is None else np.asarray(offsets, np.float64)
    xp = rot.namespace(features)
    heading, root = self.root_path(features)
    local = rot.matrix_from_6d(features[..., self["rotations"]].reshape(features.shape[:-1] + (-1, 6)))
    start = rot.to_matrix(heading)  # local rotations were made relative to it, see _inverse_kinematics
    turned, joints = {0: start}, {0: root}
    for chain in skeleton.chains:
      before = start if mode == "benchmark" else turned[chain[0]]
      for parent, joint in zip(chain[:-1], chain[1:]):
        before = turned[joint] = before @ local[..., joint - 1, :, :]
        joints[joint] = joints[parent] + before @ xp.asarray(offsets[joint], root.dtype)
    return xp.stack([joints[j] for j in range(skeleton.num_joints)], axis=-2)


def _heading(joints, skeleton, mode, smooth):
  """Quaternions (..., T, 4) that turn the facing direction of each frame to +z."""
  xp = rot.namespace(joints)
  ahead = facing(joints, skeleton, 20.0 if smooth else 0.0, benchmark_sign=mode == "benchmark")
  if mode == "corrected":
    return rot.about_axis(-xp.unwrap(rot.arctan2(ahead[..., 0], ahead[..., 2])), "y")
  heading = rot.between(ahead, xp.broadcast_to(xp.asarray(_AHEAD, ahead.dtype), ahead.shape))
  # Parity: the reference overwrites the first frame.
  first = xp.broadcast_to(xp.asarray([1.0, 0, 0, 0], heading.dtype), heading[..., :1, :].shape)
  return xp.concatenate([first, heading[..., 1:, :]], axis=-2)


def _inverse_kinematics(joints, heading, skeleton, mode):
  """Local rotations (..., T, J, 4): each bone's turn from its rest direction, relative to the bone before it."""
  xp = rot.namespace(joints)
  bones = rot.unit(joints[..., 1:, :] - joints[..., skeleton.parents[1:], :])
  turned = rot.between(xp.broadcast_to(xp.asarray(skeleton.rest_directions[1:], bones.dtype), bones.shape), bones)
  turned = xp.concatenate([heading[..., None, :], turned], axis=-2)
  before = np.array(skeleton.parents)
  if mode == "benchmark":
    # Parity: in the reference also the arm chains, which begin at the spine, start from the root's rotation.
    before[[chain[1] for chain in skeleton.chains]] = 0
  local = rot.multiply(rot.conjugate(turned[..., before[1:], :]), turned[..., 1:, :])
  return xp.concatenate([heading[..., None, :], local], axis=-2)


def canonicalize(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D, mode: str = "benchmark"
                 ) -> Float[A, "*lead t j 3"]:
  """Brings joints (T, J, 3) to the skeleton's bone lengths, onto the floor, to the origin, facing +z.

  Benchmark mode keeps bone directions, scales the root path by the length of one leg in frame 0, and puts the lowest
  point of the clip on the floor. Corrected mode uses `retarget`, which also prevents foot sliding and estimates the
  floor from the feet, and faces +z with the smoothed heading; a body that already has the skeleton's bones (to 2 mm)
  keeps its height: a piece cut out of a leap stays in the air.

  numpy gives float64. jax arrays (..., T, J, 3) keep their dtype, and in corrected mode their bones: `retarget` is not
  differentiable; call it first where the proportions differ.
  """
  placed = base.check_joints(joints, skeleton, mode)
  xp = rot.namespace(placed)
  if mode == "benchmark":
    placed = _keep_directions(placed, skeleton)
    height = placed[..., 1] - placed[..., 1].min((-2, -1), keepdims=True)
    placed = xp.stack([placed[..., 0], height, placed[..., 2]], axis=-1)
  elif xp is np and np.abs(bone_lengths(placed, skeleton) - skeleton.bone_lengths).max() * skeleton.unit > 2e-3:
    placed = retarget(placed, skeleton)  # type: ignore[assignment]
  placed = placed - placed[..., :1, :1, :] * xp.asarray([1, 0, 1], placed.dtype)
  ahead = facing(placed, skeleton, 20.0 if mode == "corrected" else 0.0)[..., :1, :]
  turn = rot.between(ahead, xp.broadcast_to(xp.asarray(_AHEAD, ahead.dtype), ahead.shape))
  return rot.rotate(turn[..., None, :], placed)


def _keep_directions(joints, skeleton):
  legs = list(skeleton.leg_bones)
  leg_length = bone_lengths(joints[..., :1, :, :], skeleton)[..., legs].sum(-1)[..., None, None]
  if is_jax(leg_length):
    leg_length = jnp.where(leg_length > 0, leg_length, 1)
  return with_lengths(joints * (skeleton.bone_lengths[legs].sum() / leg_length), skeleton)


def extract(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D, mode: str = "benchmark"
            ) -> Float[A, "*lead t-1 f"]:
  """Full features (..., T - 1, 12 J - 1) of canonical joints (see `canonicalize`); row t depends on frames t, t + 1.

  Corrected features lose the absolute heading, which `canonicalize` makes 0. numpy gives float64.
  """
  base.check_mode(mode)
  xp = rot.namespace(joints)
  joints = xp.asarray(joints, np.float64 if xp is np else None)
  heading = _heading(joints, skeleton, mode, smooth=True)
  local = _inverse_kinematics(joints, heading, skeleton, mode)
  now, step = heading[..., :-1, :], xp.diff(joints, axis=-3)
  turn = rot.multiply(heading[..., 1:, :], rot.conjugate(now))
  if mode == "corrected":
    half_turn = xp.arctan2(turn[..., 2] * xp.where(turn[..., 0] < 0, -1, 1), abs(turn[..., 0]))
  elif xp is np:
    half_turn = np.arcsin(np.clip(turn[..., 2], -1, 1))
  else:  # the same angle, with a gradient at half a turn as well
    half_turn = jnp.arctan2(turn[..., 2], abs(turn[..., 0]))
  root_step = rot.rotate(heading[..., 1:, :], step[..., 0, :])[..., [0, 2]]
  placed = joints[..., :-1, :, :]
  below = placed[..., :1, :] * xp.asarray([1, 0, 1], placed.dtype)
  positions = rot.rotate(now[..., None, :], placed[..., 1:, :] - below)
  velocities = rot.rotate(now[..., None, :], step)
  feet = list(skeleton.left_feet + skeleton.right_feet)
  contacts = (step[..., feet, :] ** 2).sum(-1) < skeleton.contact_threshold
  rows = (half_turn, root_step, placed[..., 0, 1], positions, rot.to_6d(local[..., :-1, 1:, :]), velocities, contacts)
  return base.join_rows(rows, half_turn)


def _parts(skeleton, full):
  body = tuple(range(1, skeleton.num_joints))
  parts = {"turn": Block((-1,)), "root_velocity": Block(GROUND), "root_height": Block((1,)),
           "positions": Block(VECTOR, body)}
  return parts if not full else parts | {
      "rotations": Block(ROTATION, body), "velocities": Block(VECTOR, (0, *body)),
      "contacts": Block((1,), skeleton.left_feet + skeleton.right_feet)}


FULL, FULL_KIT = (HumanML3D(name, skeleton, _parts(skeleton, True))
                  for name, skeleton in (("full", HUMANML3D), ("full_kit", KIT)))
ESSENTIAL, ESSENTIAL_KIT = (HumanML3D(name, skeleton, _parts(skeleton, False))
                            for name, skeleton in (("essential", HUMANML3D), ("essential_kit", KIT)))
