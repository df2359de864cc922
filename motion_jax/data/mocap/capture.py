"""What BVH and ASF/AMC files have in common: named joints that move, and the way from there to a Clip."""
import dataclasses
import pathlib
import warnings

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.inputs.errors import InputError
from motion_jax.motion import plausibility
from motion_jax.motion import rotations as rot
from motion_jax.motion.joint_maps import map_joints, own_joints
from motion_jax.motion.retarget import leg_scale
from motion_jax.motion.skeleton import HUMANML3D

_MOST = 8_000_000  # frames times joints: a gigabyte
_UNITS = (*plausibility.UNITS.values(), 0.1, 0.0254 / 0.45)  # and decimetres, and CMU's


@dataclasses.dataclass(frozen=True, eq=False)
class Capture:
  """A motion-capture file as read, in its own units and names; N counts its joints and the ends of its limbs."""
  names: tuple[str, ...]
  parents: tuple[int, ...]             # -1 for a root; parents come before children
  offsets: np.ndarray                  # (N, 3) from the parent, at rest
  channels: tuple[tuple[str, ...], ...]
  fps: float
  positions: np.ndarray                # (T, N, 3) in the world
  rotations: np.ndarray                # (T, N, 4) quaternions (w, x, y, z) relative to the parent
  turned: np.ndarray                   # (T, N, 4) the same in the world

  @property
  def num_frames(self) -> int:
    return len(self.positions)


def check_size(path, num_frames, num_joints):
  """Raises ValueError for a capture that memory might not hold."""
  if num_frames * num_joints > _MOST:
    raise InputError(f"{path}: got {num_frames:,} frames of {num_joints:,} joints, expected at most "
                     f"{_MOST // num_joints:,} frames of so many; cut it in parts")


def with_rate(capture, fps) -> Capture:
  """The same frames at another rate than the file states, with a warning where that differs; None changes nothing."""
  if fps is None:
    return capture
  if abs(capture.fps - fps) > 0.01 * fps:
    warnings.warn(f"a file states {capture.fps:g} frames a second, taken as {fps:g}: the motion runs at another speed "
                  "(--resample of data build changes the rate alone)", stacklevel=2)
  return dataclasses.replace(capture, fps=fps)


def to_clip(capture, path, mapping=None, fps=20.0, unit="auto", up="auto", skip_pose=None, skeleton=HUMANML3D, **about
            ) -> Clip:
  """A Capture as a Clip of 22 joints: metres, y up, frame k at k / fps seconds, with the file's own proportions.

  mapping: see `joint_maps.map_joints`; None reads the names. skeleton: of the clip; a file whose joints are those of
  another skeleton than HumanML3D's, name by name, can stay on it. unit: of the file, "m", "cm", "mm", "in", "ft" or
  metres per unit; "auto" tells it by the leg. up: "x", "y", "z" or "auto". skip_pose: leave out a pose set before the
  motion; None does so when there is one. about (captions, id, split, ...) goes to the Clip. Raises ValueError for
  joints that are no person's (`motion.plausibility`), or rates that no camera has.
  """
  path = pathlib.Path(path)
  for rate in (capture.fps, fps):
    plausibility.check_rate(rate, str(path))
  if skip_pose or (skip_pose is None and starts_with_a_pose(capture)):
    capture = without_pose(capture)
  try:
    if skeleton is HUMANML3D:
      joints, table = map_joints(capture.names, capture.positions, mapping, capture.turned, capture.parents)
    else:
      joints, table = own_joints(capture.names, capture.positions, skeleton), skeleton.name
    metres = _metres(joints, unit, skeleton)
    joints = _turn_up(joints, up, skeleton)
  except ValueError as error:
    raise InputError(f"{path}: {error}") from None
  joints = joints * (metres / skeleton.unit)
  plausibility.check(joints, skeleton, capture.fps, str(path))
  joints = resample(joints, capture.fps, fps)
  meta = {"file": path.name, "mapping": table, "unit": metres, "source_fps": round(capture.fps, 4)}
  about = {"id": path.stem, "source": path.name} | about
  return Clip(joints=joints.astype(np.float32), fps=fps, skeleton=skeleton, meta=meta | about.pop("meta", {}), **about)


def resample(values, fps, to_fps):
  """Values (T, ...) at times k / fps, taken at times k / to_fps by linear interpolation, as far as they reach."""
  seconds = (len(values) - 1) / fps
  at = np.arange(int(np.floor(seconds * to_fps + 1e-6)) + 1) * (fps / to_fps)
  first = np.minimum(np.floor(at + 1e-9).astype(int), len(values) - 1)
  weight = np.clip(at - first, 0, 1).reshape((-1,) + (1,) * (values.ndim - 1))
  return values[first] * (1 - weight) + values[np.minimum(first + 1, len(values) - 1)] * weight


def forward_kinematics(parents, local, rotations):
  """World positions (T, N, 3) and rotations (T, N, 4) from those relative to the parent."""
  positions, turned = local.copy(), rotations.copy()
  for joint, parent in enumerate(parents):
    if parent >= 0:
      positions[:, joint] = positions[:, parent] + rot.rotate(turned[:, parent], local[:, joint])
      turned[:, joint] = rot.multiply(turned[:, parent], rotations[:, joint])
  return positions, turned


def starts_with_a_pose(capture) -> bool:
  """Whether frame 0 is the rest pose, put before the motion (as cgspeed does): joints hardly turned, then a jump."""
  if capture.num_frames < 3:
    return False
  q = capture.rotations
  moving = _angles(rot.multiply(rot.conjugate(q[:1]), q)).max(0) > 1
  return bool(moving.any() and _angles(q[0, moving]).mean() < 2 and _steps(capture, 1)[0] > 5)


def without_pose(capture) -> Capture:
  """Drops frame 0. Where the converter's filter has smeared the pose into what follows (joints go on jumping, less and
  less), up to three frames take the first clean one's pose; the root keeps its own path, which is not filtered."""
  if capture.num_frames < 2:
    return capture
  steps = _steps(capture, 4)
  smeared = 0
  if len(steps) == 4 and steps[1] > steps[0] / 3 and (np.diff(steps[1:]) < 0).all():
    smeared = 1 + int((steps[2:] > steps[1] / 4).sum())
  frames = np.maximum(np.arange(1, capture.num_frames), 1 + smeared)
  root = capture.positions[:, :1]
  positions = capture.positions[frames] - root[frames] + root[1:]
  return dataclasses.replace(capture, positions=positions, rotations=capture.rotations[frames],
                             turned=capture.turned[frames])


def _steps(capture, num):
  """The largest turn of any joint, degrees, in each of the first num steps."""
  q = capture.rotations[:num + 1]
  return _angles(rot.multiply(rot.conjugate(q[:-1]), q[1:])).max(-1)


def _angles(q):
  return np.degrees(2 * np.arccos(np.clip(np.abs(q[..., 0]), 0, 1)))


def _metres(joints, unit, skeleton):
  """Metres per unit, as said, or of the usual unit that makes the leg nearest to an adult's."""
  if isinstance(unit, str) and unit != "auto":
    if unit not in plausibility.UNITS:
      raise InputError(f"got unit {unit!r}, expected auto, {', '.join(plausibility.UNITS)}")
    return plausibility.UNITS[unit]
  if unit not in ("auto", None):
    return unit
  scale = leg_scale(joints, skeleton) * skeleton.unit
  return min(_UNITS, key=lambda unit: abs(np.log(unit / scale)))


def _turn_up(joints, up, skeleton):
  """Turns joints so that up is +y; "auto" takes the axis along which heads are above feet."""
  if up == "auto":
    feet = list(skeleton.left_feet + skeleton.right_feet)
    rise = np.median(joints[:, skeleton.joints.index("neck")] - joints[:, feet].mean(1), axis=0)
    # A clip of somebody lying down says nothing: then the file is taken to be y up, as most are.
    up = "xyz"[int(np.abs(rise).argmax())] if np.abs(rise).max() > 2 * np.abs(rise[1]) else "y"
  if up not in plausibility.AXES:
    raise InputError(f"got up {up!r}, expected x, y, z or auto")
  return joints[..., plausibility.AXES[up]]
