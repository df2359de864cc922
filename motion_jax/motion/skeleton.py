"""Skeletons: joints, their tree, bone lengths and rest poses; facing direction and axes of the body.

Axes: y up, +z ahead, +x to the body's left.
"""
import dataclasses
from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.motion.smoothing import gaussian
from motion_jax.shapes import Bool, Float, Num

# Direction of each kind of bone in the T-pose; x is for the left side and is mirrored for the right.
_REST = {
    "hip": (0.74, -0.67, 0), "knee": (0, -1, 0), "ankle": (0, -1, 0), "heel": (0, -0.8, -0.6), "foot": (0, -0.45, 0.9),
    "spine1": (0, 1, 0), "spine2": (0, 1, 0), "spine3": (0, 1, 0), "torso_low": (0, 1, 0), "torso_high": (0, 1, 0),
    "neck": (0, 1, 0), "neck2": (0, 1, 0), "pelvis": (0, -1, 0), "head": (0, 0.95, 0.3),
    "collar": (0.65, 0.755, -0.085), "shoulder": (1, 0, 0), "elbow": (1, 0, 0), "wrist": (1, 0, 0)}
SIDES = "left", "right"
THIN = 0.02  # of the legs' length: joints closer together define no direction


@dataclasses.dataclass(frozen=True, eq=False)
class Skeleton:
  """A tree of J joints with the tables that features need.

  `bone_lengths[j]` is the length of the bone that ends at joint j, in units of `unit` metres. The chains are those of
  the benchmark's inverse kinematics (HumanML3D `paramUtil.py`); together they define each joint's parent.
  """
  name: str
  joints: tuple[str, ...]
  chains: tuple[tuple[int, ...], ...]
  rest_directions: Float[np.ndarray, "j 3"]  # unit vectors, the root's is zero
  bone_lengths: Float[np.ndarray, " j"]      # the root's is zero
  hips: tuple[int, int]        # right, left
  shoulders: tuple[int, int]   # right, left
  leg_bones: tuple[int, int]   # thigh and shin of one leg: they set the scale of a person
  left_feet: tuple[int, int]   # ankle, toes
  right_feet: tuple[int, int]
  contact_threshold: float     # squared step, unit^2 per frame^2, below which a foot is labelled as standing
  fps: float
  unit: float                  # metres per unit

  def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
    known = SKELETONS.get(self.name) is self  # pickled by name: another process has its own instance
    return (_known_skeleton, (self.name,)) if known else super().__reduce_ex__(protocol)

  @property
  def num_joints(self) -> int:
    return len(self.joints)

  @property
  def parents(self) -> tuple[int, ...]:
    parents = [-1] * self.num_joints
    for chain in self.chains:
      for parent, child in zip(chain[:-1], chain[1:]):
        parents[child] = parent
    return tuple(parents)

  @property
  def children(self) -> list[list[int]]:
    """Of each joint, the joints whose parent it is."""
    parents = self.parents
    return [[child for child, parent in enumerate(parents) if parent == joint] for joint in range(self.num_joints)]

  @property
  def order(self) -> list[int]:
    """Joints, parents before children."""
    children, order = self.children, [0]
    for joint in order:
      order.extend(children[joint])
    return order

  def descendants(self, joint: int) -> list[int]:
    """Joints below a joint, parents before children."""
    children = self.children
    joints = list(children[joint])
    for descendant in joints:
      joints.extend(children[descendant])
    return joints

  @property
  def mirror(self) -> tuple[int, ...]:
    """Of each joint, the joint with which a mirror exchanges it."""
    swap = lambda name: ("right" + name[4:] if name.startswith("left")
                         else "left" + name[5:] if name.startswith("right") else name)
    return tuple(self.joints.index(swap(name)) for name in self.joints)

  @property
  def offsets(self) -> Float[np.ndarray, "j 3"]:
    """Joint minus parent in the rest pose, in the skeleton's unit."""
    return self.rest_directions * self.bone_lengths[:, None]

  def with_offsets(self, offsets: Num[np.ndarray, "j 3"]) -> "Skeleton":
    """The same tree with other bone lengths, those of offsets (J, 3)."""
    return dataclasses.replace(self, bone_lengths=np.linalg.norm(np.asarray(offsets, np.float64), axis=-1))


_AXES = {"0": (0, 0, 0), "+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0),
         "+z": (0, 0, 1), "-z": (0, 0, -1)}


def _directions(text: str) -> Float[np.ndarray, "j 3"]:
  return np.array([_AXES[axis] for axis in text.split()], np.float64)


# Bone lengths: measured on HumanML3D clip 012314, whose skeleton is frame 0 of raw clip 000021.
HUMANML3D = Skeleton(
    name="humanml3d",
    joints=("pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle",
            "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head",
            "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    chains=((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15), (9, 14, 17, 19, 21), (9, 13, 16, 18, 20)),
    rest_directions=_directions("0 +x -x +y -y -y +y -y -y +y +z +z +y +x -x +z -y -y -y -y -y -y"),
    bone_lengths=np.array([
        0, 0.103074, 0.109883, 0.131568, 0.393623, 0.390188, 0.143190, 0.432433, 0.425643, 0.057365, 0.143382,
        0.149419, 0.219360, 0.137487, 0.143383, 0.103039, 0.131614, 0.122984, 0.256840, 0.263092, 0.266012,
        0.269876]),
    hips=(2, 1), shoulders=(17, 16), leg_bones=(5, 8), left_feet=(7, 10), right_feet=(8, 11),
    contact_threshold=0.002, fps=20.0, unit=1.0)

# The official KIT bone lengths are frame 0 of raw clip 03950 (`Skeleton.with_offsets` takes them); those below, in
# millimetres, are an adult's of much the same build, for use without that file. The rest directions of joints 5..15
# point to the other side than the joints lie (joint 11 is the right hip, at negative x), as in the reference.
KIT = Skeleton(
    name="kit",
    joints=("root", "torso_low", "torso_high", "neck", "head", "right_shoulder", "right_elbow", "right_wrist",
            "left_shoulder", "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle", "right_heel",
            "right_foot", "left_hip", "left_knee", "left_ankle", "left_heel", "left_foot"),
    chains=((0, 11, 12, 13, 14, 15), (0, 16, 17, 18, 19, 20), (0, 1, 2, 3, 4), (3, 5, 6, 7), (3, 8, 9, 10)),
    rest_directions=_directions("0 +y +y +y +y +x -y -y -x -y -y +x -y -y +z +z -x -y -y +z +z"),
    bone_lengths=np.array([
        0, 136, 153, 238, 148, 160, 285, 248, 160, 285, 248, 89.5, 380, 398, 100, 74, 89.5, 380, 398, 100, 74.0]),
    hips=(11, 16), shoulders=(5, 8), leg_bones=(17, 18), left_feet=(19, 20), right_feet=(14, 15),
    contact_threshold=0.05, fps=12.5, unit=0.001)


def _from_offsets(offsets: Sequence[tuple[float, float, float]], **fields: Any) -> Skeleton:
  """A skeleton from the offsets (J, 3) of its rest pose, for data whose rotations are relative to that pose."""
  vectors = np.array(offsets, np.float64)
  lengths = np.linalg.norm(vectors, axis=-1)
  return Skeleton(rest_directions=vectors / np.maximum(lengths, 1e-12)[:, None], bone_lengths=lengths, **fields)


# SMPL's 22 body joints in its T-pose, to which the rotations of 272 and 135 features are relative (MotionStreamer,
# BABEL). An adult's, rounded to the millimetre and symmetric: the body model itself has a licence of its own and is not
# included. Recovery takes exact offsets as an argument.
SMPL = _from_offsets(
    [(0, 0, 0), (0.059, -0.086, -0.016), (-0.059, -0.086, -0.016), (0, 0.124, -0.038), (0.043, -0.385, 0.002),
     (-0.043, -0.385, 0.002), (0, 0.138, 0.027), (-0.017, -0.423, -0.036), (0.017, -0.423, -0.036), (0, 0.056, 0.003),
     (0.038, -0.061, 0.126), (-0.038, -0.061, 0.126), (0, 0.212, -0.033), (0.077, 0.113, -0.021),
     (-0.077, 0.113, -0.021), (0, 0.089, 0.050), (0.118, 0.046, -0.014), (-0.118, 0.046, -0.014),
     (0.258, -0.015, -0.027), (-0.258, -0.015, -0.027), (0.267, 0.010, -0.007), (-0.267, 0.010, -0.007)],
    name="smpl", joints=HUMANML3D.joints, chains=HUMANML3D.chains, hips=(2, 1), shoulders=(17, 16), leg_bones=(5, 8),
    left_feet=(7, 10), right_feet=(8, 11), contact_threshold=0.002, fps=30.0, unit=1.0)

# SnapMoGen's figure of 1.1 m, centimetres (rest pose of the dataset's BVH files: a T-pose, no rotation anywhere). Its
# root and its pelvis coincide; the shoulders that define the heading are the clavicles.
SNAPMOGEN = _from_offsets(
    [(0, 0, 0), (0, 1.619, 0), (0, 4.942, 0), (0, 4.8606, 0), (0, 17.026, 0), (0, 3.25, 0), (0, 5.278, 0),
     (4.59, 12.067, 0.834), (7.8296, -0.0005, -3.4524), (16.585, 0, 0.0015), (16.988, 0, 0.0015),
     (-4.59, 12.067, 0.834), (-7.8296, -0.0005, -3.4524), (-16.585, 0, 0.0015), (-16.987, 0, 0.0015),
     (0, 0, 0), (6.6, -6.027, 0.539), (-0.143, -19.1874, 0.0403), (-0.1344, -18.0343, -1.0449),
     (-0.0001, -5.3923, 9.6029), (-6.6, -6.027, 0.539), (0.143, -19.1871, 0.0405), (0.1344, -18.0343, -1.0448),
     (0.0001, -5.3923, 9.6029)],
    name="snapmogen",
    joints=("root", "spine1", "spine2", "spine3", "neck", "neck2", "head", "left_collar", "left_shoulder", "left_elbow",
            "left_wrist", "right_collar", "right_shoulder", "right_elbow", "right_wrist", "pelvis", "left_hip",
            "left_knee", "left_ankle", "left_foot", "right_hip", "right_knee", "right_ankle", "right_foot"),
    chains=((0, 15, 20, 21, 22, 23), (15, 16, 17, 18, 19), (0, 1, 2, 3, 4, 5, 6), (3, 11, 12, 13, 14),
            (3, 7, 8, 9, 10)),
    hips=(20, 16), shoulders=(11, 7), leg_bones=(17, 18), left_feet=(18, 19), right_feet=(22, 23),
    contact_threshold=0.11, fps=30.0, unit=0.01)

# Joint names in the dataset's BVH files, in the order of the features.
SNAPMOGEN_BVH = ("ROOT",) + tuple(f"{name}_bind_JNT" for name in (
    "C_spine0001", "C_spine0002", "C_spine0003", "C_neck0001", "C_neck0002", "C_head",
    "L_clavicle", "L_armUpper0001", "L_armLower0001", "L_hand0001",
    "R_clavicle", "R_armUpper0001", "R_armLower0001", "R_hand0001", "C_pelvis0001",
    "L_legUpper0001", "L_legLower0001", "L_foot0001", "L_foot0002",
    "R_legUpper0001", "R_legLower0001", "R_foot0001", "R_foot0002"))

SKELETONS = {skeleton.name: skeleton for skeleton in (HUMANML3D, KIT, SMPL, SNAPMOGEN)}


def _known_skeleton(name: str) -> "Skeleton":
  return SKELETONS[name]


def bone_lengths(joints: Num[A, "*lead j 3"], skeleton: Skeleton) -> Float[A, "*lead j"]:
  """Lengths (..., J) of the bones that end at each joint; the root's is 0."""
  return rot.length(joints - joints[..., np.maximum(skeleton.parents, 0), :])


def with_own_lengths(joints: Num[np.ndarray, "t j 3"], skeleton: Skeleton) -> Skeleton:
  """The skeleton with the bone lengths of joints (T, J, 3): medians over the frames."""
  return dataclasses.replace(skeleton, bone_lengths=np.median(bone_lengths(joints, skeleton), axis=0))


def t_pose(skeleton: Skeleton = HUMANML3D, lengths: Float[np.ndarray, " j"] | None = None) -> Float[np.ndarray, "j 3"]:
  """Offsets (J, 3) from the parent in a T-pose: facing +z, arms along x, legs down. lengths (J,): the skeleton's."""
  lengths = skeleton.bone_lengths if lengths is None else lengths
  offsets = np.zeros((skeleton.num_joints, 3))
  for joint, name in enumerate(skeleton.joints[1:], 1):
    side, kind = side_and_kind(name)
    offsets[joint] = rot.unit(np.array(_REST[kind], np.float64) * [side, 1, 1]) * lengths[joint]
  return offsets


def side_and_kind(name: str) -> tuple[int, str]:
  """+1 for left, -1 for right, 1 otherwise, and the name without its side."""
  side, _, rest = name.partition("_")
  return {"left": (1, rest), "right": (-1, rest)}.get(side, (1, name))


def facing(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D, smooth: float = 0.0,
           benchmark_sign: bool = False) -> Float[A, "*lead t 3"]:
  """Facing direction: unit vectors (..., T, 3) in the ground plane, from the lines through hips and shoulders.

  smooth: sigma, in frames, of a Gaussian over time. benchmark_sign: give the hips the wrong sign, as HumanML3D does.
  """
  (right_hip, left_hip), (right_shoulder, left_shoulder) = skeleton.hips, skeleton.shoulders
  across_hips = joints[..., right_hip, :] - joints[..., left_hip, :]
  across = (-across_hips if benchmark_sign else across_hips) + joints[..., right_shoulder, :]
  across = across - joints[..., left_shoulder, :]
  xp: Any = rot.namespace(joints)
  up = np.array([0.0, 1.0, 0.0])
  ahead = xp.cross(up if xp is np else xp.asarray(up, across.dtype), rot.unit(across))
  if smooth:
    ahead = gaussian(ahead, smooth)
  return rot.unit(ahead)


def body_axes(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D
              ) -> tuple[Float[A, "*lead t 3 3"], Float[A, "*lead t 3 3"]]:
  """Orientation of pelvis and chest: matrices (..., T, 3, 3) whose columns point to the left, up and ahead.

  Left is along the line through the hips, or the shoulders. Up is from the middle of the hips to the first joint of the
  trunk that does not coincide with it, and from the chest to the neck, or the next joint that does not coincide. Where
  hips or shoulders have no width (their joints coincide), the other pair is used; no axis of the world is.
  """
  xp: Any = rot.namespace(joints)
  joints = xp.asarray(joints, np.float64 if xp is np else None)
  back, chest = skeleton.chains[2], skeleton.chains[3][0]
  neck = back.index(chest) + 1
  thin = THIN * xp.median(bone_lengths(joints, skeleton)[..., list(skeleton.leg_bones)].sum(-1), axis=-1)
  left = [joint for joint, name in enumerate(skeleton.joints) if name.startswith("left")]
  across = lambda pair: joints[..., pair[1], :] - joints[..., pair[0], :]
  hips, shoulders = across(skeleton.hips), across(skeleton.shoulders)
  sides = (joints[..., left, :] - joints[..., [skeleton.mirror[joint] for joint in left], :]).mean(-2)
  low = joints[..., list(skeleton.hips), :].mean(-2)
  trunk = [joints[..., joint, :] - low for joint in back[1:]]
  collar = [joints[..., joint, :] - joints[..., chest, :] for joint in back[neck:]]
  spine = [joints[..., chest, :] - joints[..., joint, :] for joint in reversed(back[:neck - 1])]
  return _axes((hips, shoulders, sides), trunk, thin), _axes((shoulders, hips, sides), collar + spine, thin)


def _axes(lefts: Sequence[Any], ups: Sequence[Any], thin: Any) -> Any:
  """Matrices (..., T, 3, 3) from the first upward and the first leftward vectors that are longer than thin."""
  xp: Any = rot.namespace(*lefts)
  up = unit_or_nearest(_first_not_thin(xp.stack(ups), xp.stack(ups), thin, otherwise=0))
  flat = xp.stack([v - up * (v * up).sum(-1, keepdims=True) for v in lefts])
  # The part's own line is kept; that of another part is made perpendicular to up.
  left = unit_or_nearest(_first_not_thin(flat, xp.concatenate([lefts[0][None], flat[1:]]), thin, otherwise=-1))
  ahead = unit_or_nearest(xp.cross(left, up))
  return xp.stack([left, xp.cross(ahead, left), ahead], axis=-1)


def _first_not_thin(vectors: Float[A, "n *lead t 3"], values: Float[A, "n *lead t 3"], thin: Any, otherwise: int
                    ) -> Float[A, "*lead t 3"]:
  """For each motion the values (..., T, 3) that belong to its first vectors (..., T, 3) longer than thin (...)."""
  xp: Any = rot.namespace(vectors)
  thick = xp.median(rot.length(vectors), axis=-1) > thin
  first = xp.where(thick.any(0), thick.argmax(0), otherwise % len(vectors))
  return xp.take_along_axis(values, first[None, ..., None, None], axis=0)[0]


def unit_or_nearest(v: Float[A, "*lead t 3"]) -> Float[A, "*lead t 3"]:
  """Unit vectors (..., T, 3); a zero vector takes the direction of the last good frame, else of the first good one."""
  length = rot.length(v)[..., None]
  good = length > 1e-9
  return from_nearest(v / rot.namespace(v).where(good, length, 1), good[..., 0])


def from_nearest(values: Float[A, "*values"], good: Bool[A, "*lead t"]) -> Float[A, "*values"]:
  """Values (..., T, ...); frames that are not good take the value of the last good frame, else of the first good."""
  xp: Any = rot.namespace(values, good)
  if xp is np and (good.all() or not good.any()):
    return values
  frame = xp.arange(good.shape[-1])
  last = xp.maximum.accumulate(xp.where(good, frame, -1), axis=-1)
  source = xp.where(last < 0, good.argmax(-1)[..., None], last)
  source = xp.where(good.any(-1, keepdims=True), source, frame)
  return xp.take_along_axis(values, source.reshape(source.shape + (1,) * (values.ndim - good.ndim)), good.ndim - 1)
