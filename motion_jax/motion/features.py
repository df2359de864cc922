"""Feature vectors: named blocks of numbers that say what a body does in one frame, and the way back to joints.

Full features (HumanML3D 263, KIT 251) describe a frame in the frame of reference of the body: the root's turn and step,
then joint positions, rotations and velocities with the heading taken out, then foot contacts. Essential features (67,
64) are their first three kinds. Coordinates (66, 63) are the joints themselves.

Three more representations have a module each, with their columns in its docstring: SnapMoGen's 296 (`features296`),
MotionStreamer's 272 (`features272`), BABEL's 135 (`features135`). They hold rotations that joints do not tell: what is
made here from joints has the plainest ones (`inverse`); the modules make features from files that have them.

Two modes make full features from joints:

- "benchmark" follows HumanML3D's `motion_representation.ipynb` bug for bug, so that numbers compare with the
  literature (docs/papers/cdamd.md#features): hips and shoulders enter the heading with opposite signs; the heading of
  frame 0 is overwritten by the identity; the turn has the wrong sign in a row where the heading passes 180 degrees; an
  arm's first rotation is relative to the root.
- "corrected" is right: equal signs, frame 0 turned to +z by its smoothed heading (so nothing needs overwriting), turns
  by the wrapped angle, an arm's first rotation relative to the spine. Joints come back exactly.
"""
import dataclasses

import numpy as np

from motion_jax.motion import features135, features272, features296, inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D, KIT, SKELETONS, SMPL, SNAPMOGEN, Skeleton

MODES = ("benchmark", "corrected")
_UP, _AHEAD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclasses.dataclass(frozen=True, eq=False)
class FeatureLayout:
  """Names for the columns of a feature vector: `layout["positions"]` is a slice."""
  name: str
  kind: str  # "full", "essential", "coordinates", or one with its own module: "snapmogen", "motionstreamer", "babel"
  skeleton: Skeleton
  blocks: dict[str, slice]

  @property
  def dim(self) -> int:
    return max(block.stop for block in self.blocks.values())

  @property
  def root(self) -> slice:
    """The columns that the tokenizer's root loss looks at: turn, step and height of most layouts.

    Source: docs/papers/cmdm.md#data-sets.
    """
    return slice(0, 4)

  def __getitem__(self, name) -> slice:
    if name not in self.blocks:
      raise KeyError(f"layout {self.name!r} has no block {name!r}; it has {', '.join(self.blocks)}")
    return self.blocks[name]

  def check(self, features):
    if features.shape[-1] != self.dim:
      raise ValueError(f"got {features.shape[-1]} features per frame, layout {self.name!r} has {self.dim}; "
                       "joints become features with motion_jax.motion.features.to_features(joints)")


def _blocks(sizes):
  ends = np.cumsum(list(sizes.values()))
  return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends)}


def _make_layout(kind, skeleton):
  joints = skeleton.num_joints
  sizes = {"coordinates": 3 * joints} if kind == "coordinates" else {
      "turn": 1, "root_velocity": 2, "root_height": 1, "positions": 3 * (joints - 1)}
  if kind == "full":
    sizes |= {"rotations": 6 * (joints - 1), "velocities": 3 * joints, "contacts": 4}
  name = kind if skeleton is HUMANML3D else f"{kind}_{skeleton.name}"
  return FeatureLayout(name, kind, skeleton, _blocks(sizes))


_EVALUATED = {name: features296.BLOCKS[name] for name in ("turn", "root_velocity", "root_height", "rotations")}
LAYOUTS = {layout.name: layout for layout in (
    *(_make_layout(kind, skeleton) for skeleton in (HUMANML3D, KIT) for kind in ("full", "essential", "coordinates")),
    FeatureLayout("snapmogen", "snapmogen", SNAPMOGEN, _blocks(features296.BLOCKS)),
    FeatureLayout("snapmogen_148", "snapmogen", SNAPMOGEN, _blocks(_EVALUATED)),
    FeatureLayout("motionstreamer", "motionstreamer", SMPL, _blocks(features272.BLOCKS)),
    FeatureLayout("babel", "babel", SMPL, _blocks(features135.BLOCKS)))}
_OWN = {"snapmogen": features296, "motionstreamer": features272, "babel": features135}


def get_layout(layout) -> FeatureLayout:
  """A layout from its name; a layout passes through."""
  if isinstance(layout, FeatureLayout):
    return layout
  if layout not in LAYOUTS:
    raise ValueError(f"got layout {layout!r}, expected one of {', '.join(LAYOUTS)}")
  return LAYOUTS[layout]


def layout_for(num_features) -> FeatureLayout:
  """The layout with so many numbers per frame."""
  for layout in LAYOUTS.values():
    if layout.dim == num_features:
      return layout
  known = ", ".join(f"{layout.dim} ({layout.name})" for layout in LAYOUTS.values())
  raise ValueError(f"got {num_features} features per frame; known sizes are {known}")


def _check_mode(mode):
  if mode not in MODES:
    raise ValueError(f"got mode {mode!r}, expected one of {', '.join(MODES)}")


def facing(joints, skeleton=HUMANML3D, smooth=0.0, benchmark_sign=False):
  """Where the body faces: unit vectors (T, 3) in the ground plane, from the lines through hips and shoulders.

  smooth is the sigma in frames of a Gaussian over time. benchmark_sign takes the hips with the wrong sign.
  """
  from scipy.ndimage import gaussian_filter1d
  (right_hip, left_hip), (right_shoulder, left_shoulder) = skeleton.hips, skeleton.shoulders
  across_hips = joints[:, right_hip] - joints[:, left_hip]
  across = (-across_hips if benchmark_sign else across_hips) + joints[:, right_shoulder] - joints[:, left_shoulder]
  ahead = np.cross(_UP, rot.unit(across))
  if smooth:
    ahead = gaussian_filter1d(ahead, smooth, axis=0, mode="nearest")
  return rot.unit(ahead)


def _heading(joints, skeleton, mode, smooth):
  """Quaternions (T, 4) that turn the facing direction of each frame to +z."""
  ahead = facing(joints, skeleton, 20.0 if smooth else 0.0, benchmark_sign=mode == "benchmark")
  if mode == "corrected":
    return rot.about_axis(-np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2])), "y")
  heading = rot.between(ahead, np.broadcast_to(_AHEAD, ahead.shape))
  heading[0] = (1, 0, 0, 0)  # Parity: the reference overwrites the first frame
  return heading


def _inverse_kinematics(joints, heading, skeleton, mode):
  """Local rotations (T, J, 4): each bone's turn from its rest direction, relative to the bone before it."""
  turned = {0: heading}
  local = np.zeros(joints.shape[:2] + (4,))
  local[:, 0] = heading
  for chain in skeleton.chains:
    # Parity: in the reference also the arm chains, which begin at the spine, start from the root's rotation.
    before = heading if mode == "benchmark" else turned[chain[0]]
    for parent, joint in zip(chain[:-1], chain[1:]):
      bone = rot.unit(joints[:, joint] - joints[:, parent])
      turned[joint] = rot.between(np.broadcast_to(skeleton.rest_directions[joint], bone.shape), bone)
      local[:, joint] = rot.multiply(rot.conjugate(before), turned[joint])
      before = turned[joint]
  return local


def canonicalize(joints, skeleton=HUMANML3D, mode="benchmark"):
  """Joints (T, J, 3) onto the skeleton's bone lengths, on the floor, starting at the origin and facing +z. float64.

  Benchmark mode keeps bone directions, scales the root path by the length of one leg in frame 0, and puts the lowest
  point of the clip on the floor. Corrected mode leaves bones to `retarget`, which also keeps feet where they stood and
  finds the floor under them, and faces +z with the smoothed heading; a body that has the skeleton's bones already
  (to 2 mm) keeps its height, so that a piece cut out of a leap stays in the air.
  """
  joints = _check_joints(joints, skeleton, mode)
  if mode == "benchmark":
    joints = _keep_directions(joints, skeleton)
    joints[..., 1] -= joints[..., 1].min()
  elif np.abs(bone_lengths(joints, skeleton) - skeleton.bone_lengths).max() * skeleton.unit > 2e-3:
    joints = retarget(joints, skeleton)
  joints = joints - joints[0, 0] * [1, 0, 1]
  ahead = facing(joints, skeleton, 20.0 if mode == "corrected" else 0.0)[:1]
  return rot.rotate(rot.between(ahead, _AHEAD[None])[:, None], joints)


def _check_joints(joints, skeleton, mode):
  _check_mode(mode)
  joints = np.asarray(joints, np.float64)
  if joints.ndim != 3 or joints.shape[1:] != (skeleton.num_joints, 3) or len(joints) < 2:
    raise ValueError(f"got joints of shape {joints.shape}, expected (at least 2 frames, {skeleton.num_joints}, 3)")
  if not np.isfinite(joints).all():
    raise ValueError(f"joints hold NaN or infinity, first in frame {np.argwhere(~np.isfinite(joints))[0, 0]}")
  return joints


def bone_lengths(joints, skeleton):
  """Lengths (T, J) of the bones that end at each joint; the root's is 0."""
  parents = np.maximum(skeleton.parents, 0)
  return np.linalg.norm(joints - joints[:, parents], axis=-1)


def _keep_directions(joints, skeleton):
  legs = list(skeleton.leg_bones)
  scale = skeleton.bone_lengths[legs].sum() / bone_lengths(joints[:1], skeleton)[0, legs].sum()
  result = np.empty_like(joints)
  result[:, 0] = joints[:, 0] * scale
  for joint, parent in _bones(skeleton):
    direction = rot.unit(joints[:, joint] - joints[:, parent])
    result[:, joint] = result[:, parent] + direction * skeleton.bone_lengths[joint]
  return result


def _bones(skeleton):
  """(joint, parent) pairs in an order that meets every parent before its children."""
  return [(joint, parent) for chain in skeleton.chains for parent, joint in zip(chain[:-1], chain[1:])]


def extract(joints, skeleton=HUMANML3D, mode="benchmark"):
  """Full features (T - 1, 12 J - 1), float64, of joints that are canonical already; row t looks at frames t, t + 1.

  Corrected features lose the absolute heading; `canonicalize` makes it 0.
  """
  _check_mode(mode)
  joints = np.asarray(joints, np.float64)
  heading = _heading(joints, skeleton, mode, smooth=True)
  local = _inverse_kinematics(joints, heading, skeleton, mode)
  now, step = heading[:-1], np.diff(joints, axis=0)
  turn = rot.multiply(heading[1:], rot.conjugate(now))
  if mode == "benchmark":
    half_turn = np.arcsin(np.clip(turn[:, 2], -1, 1))
  else:
    half_turn = np.arctan2(turn[:, 2] * np.sign(turn[:, 0]), np.abs(turn[:, 0]))
  root_step = rot.rotate(heading[1:], step[:, 0])[:, [0, 2]]
  centred = joints[:-1, 1:] - joints[:-1, :1] * [1, 0, 1]
  positions = rot.rotate(now[:, None], centred)
  velocities = rot.rotate(now[:, None], step)
  feet = list(skeleton.left_feet + skeleton.right_feet)
  contacts = (step[:, feet] ** 2).sum(-1) < skeleton.contact_threshold
  rows = (half_turn, root_step, joints[:-1, 0, 1], positions, rot.to_6d(local[:-1, 1:]), velocities, contacts)
  return np.concatenate([np.reshape(row, (len(step), -1)) for row in rows], axis=1)


def to_features(joints, layout="full", mode="benchmark"):
  """Joints (T, J, 3) to features (T - 1, F), float32; coordinates keep as many rows, those of the recovered joints.

  "motionstreamer" and "babel" make T rows, not T - 1. Raises ValueError for a wrong shape, numbers that are not finite,
  or a body without a direction: bones of no length, hips and shoulders in one point or on a vertical.
  """
  layout = get_layout(layout)
  with np.errstate(invalid="ignore", divide="ignore"):
    if layout.kind in _OWN:
      full = _from_positions(_check_joints(joints, layout.skeleton, mode), layout, mode).astype(np.float32)
    else:
      full = extract(canonicalize(joints, layout.skeleton, mode), layout.skeleton, mode).astype(np.float32)
  if not np.isfinite(full).all():
    raise ValueError(f"no features in row {np.argwhere(~np.isfinite(full))[0, 0]}: a bone has no length, or hips and "
                     "shoulders do not tell where the body faces; check the joint mapping or cut these frames away")
  if layout.kind == "coordinates":
    return to_joints(full, _full(layout)).reshape(len(full), -1)
  return full[:, :layout.dim]


def _from_positions(joints, layout, mode):
  """Features of a representation that holds rotations, with the plainest ones that these positions allow."""
  turned = inverse.world_rotations(joints, layout.skeleton)
  if layout.kind == "snapmogen":
    return features296.extract(joints, turned, mode)
  if layout.kind == "motionstreamer":
    return features272.extract(joints, inverse.relative(turned, layout.skeleton))
  return features135.extract(*features135.from_ours(joints, turned), mode)


def _full(layout):
  return next(other for other in LAYOUTS.values() if other.kind == "full" and other.skeleton is layout.skeleton)


def root_path(features, layout="full"):
  """Heading quaternions (..., T, 4) and root positions (..., T, 3) that the columns of the root tell.

  numpy input is summed in float64, jax input in its own type, also inside jit.
  """
  layout = get_layout(layout)
  if layout.kind in _OWN:
    return _OWN[layout.kind].root_path(features)
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


def to_joints(features, layout="full"):
  """Features (..., T, F) to joints (..., T, J, 3) from the position columns (docs/papers/cdamd.md#features).

  A pure function: numpy in, float32 numpy out; jax arrays and tracers stay jax.
  """
  layout = get_layout(layout)
  xp = rot.namespace(features)
  features = xp.asarray(features)
  layout.check(features)
  num_joints = layout.skeleton.num_joints
  if layout.kind in _OWN:
    return _OWN[layout.kind].to_joints(features)
  if layout.kind == "coordinates":
    return features.reshape(features.shape[:-1] + (num_joints, 3))
  heading, root = root_path(features)
  local = features[..., layout["positions"]].reshape(features.shape[:-1] + (num_joints - 1, 3))
  turned = rot.rotate(rot.conjugate(heading)[..., None, :], local)
  around = xp.stack([root[..., 0], xp.zeros_like(root[..., 0]), root[..., 2]], axis=-1)
  joints = xp.concatenate([root[..., None, :], turned + around[..., None, :]], axis=-2)
  return joints.astype(np.float32) if xp is np else joints


def rotations_to_joints(features, layout="full", offsets=None, mode="benchmark"):
  """Features (..., T, F) to joints (..., T, J, 3) from the rotation columns, by forward kinematics.

  offsets (J, 3) are the skeleton's own by default; mode is the one that the features were made with.
  """
  _check_mode(mode)
  layout = get_layout(layout)
  layout.check(features)
  if layout.kind == "babel":
    return features135.to_joints(features, offsets)
  if layout.kind in _OWN:
    return _OWN[layout.kind].rotations_to_joints(features, offsets)
  skeleton = layout.skeleton
  offsets = skeleton.offsets if offsets is None else np.asarray(offsets, np.float64)
  xp = rot.namespace(features)
  heading, root = root_path(features)
  local = rot.matrix_from_6d(features[..., layout["rotations"]].reshape(features.shape[:-1] + (-1, 6)))
  base = rot.to_matrix(heading)  # local rotations were made relative to it, see _inverse_kinematics
  turned, joints = {0: base}, {0: root}
  for chain in skeleton.chains:
    before = base if mode == "benchmark" else turned[chain[0]]
    for parent, joint in zip(chain[:-1], chain[1:]):
      before = turned[joint] = before @ local[..., joint - 1, :, :]
      joints[joint] = joints[parent] + before @ xp.asarray(offsets[joint], root.dtype)
  return xp.stack([joints[j] for j in range(skeleton.num_joints)], axis=-2)


__all__ = ["LAYOUTS", "SKELETONS", "FeatureLayout", "canonicalize", "extract", "facing", "get_layout", "layout_for",
           "root_path", "rotations_to_joints", "to_features", "to_joints"]
