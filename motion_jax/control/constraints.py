"""The kinds of constraint as dataclasses: paths, poses, targets of hands and feet, loops, kept body parts.

World metres, Y up; times are seconds from the motion's first frame; headings are radians about +Y, 0 = +Z, towards +X.
`control.compiling.compile` turns paths, poses and targets into arrays; a loop, a motion in place and kept parts are
applied to the finished motion (`control.finishing`).
"""
import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean

# Joint indices by our names, by everyday names of end effectors, and by Kimodo's names.
JOINTS = {name: number for number, name in enumerate(HUMANML3D.joints)} | {
    "left_hand": 20, "right_hand": 21, "root": 0, "hips": 0}
KIMODO_JOINTS = {"LeftHand": "left_hand", "RightHand": "right_hand", "LeftFoot": "left_foot",
                 "RightFoot": "right_foot", "Hips": "pelvis"}
PARTS = ("legs", "torso", "left_arm", "right_arm", "head")
LONGEST_SLACK, LEAST_STRENGTH = 5.0, 0.01  # seconds; share of the way to a target
_FARTHEST = 1e4  # metres
_SLOWEST = 1e-4  # metres a second: least speed along a path


@dataclasses.dataclass(frozen=True, eq=False)
class Constraint:
  """Base class of constraints on a motion; `kind` is the name in files."""
  kind: ClassVar[str] = ""


@dataclasses.dataclass(frozen=True, eq=False)
class RootPath(Constraint):
  """Path of the pelvis: waypoints (N, 2) of x and z or (N, 3) of x, y and z, on a smooth curve.

  times (N,): time of each waypoint; without them the speed is constant: `speed`, metres a second, or else such that the
  path takes the whole motion. heading: facing direction, one angle or one per point; by default along the path. Without
  points: follow speed and heading, one each or one for each of times, from the origin. between: False constrains the
  waypoints only.
  """
  kind: ClassVar[str] = "root_path"
  points: Any = None
  times: Any = None
  speed: Any = None
  heading: Any = None
  between: bool = True

  def __post_init__(self) -> None:
    _keep(self, "points", _numbers(self.points, "the points of a root path", 2, (2, 3)))
    _keep(self, "times", _times(self.times, "a root path"))
    for name in ("speed", "heading"):
      value = _numbers(getattr(self, name), f"the {name} of a root path", None)
      _keep(self, name, value)
    if self.points is None:
      if self.speed is None or self.heading is None:
        raise InputError("got a root path without points; give points, or both a speed and a heading")
      counts = {np.size(x) for x in (self.speed, self.heading) if np.ndim(x)}
      if counts and (self.times is None or counts != {len(self.times)}):
        raise InputError("got several speeds or headings of a root path; give a time for each of them")
    elif self.times is not None and len(self.times) != len(self.points):
      raise InputError(f"got {len(self.points)} points and {len(self.times)} times of a path; "
                       "give one each")
    elif np.ndim(self.heading) and len(self.heading) != len(self.points):
      raise InputError(f"got {len(self.points)} points and {len(self.heading)} headings of a path; give one angle, or "
                       "one for each")
    if self.points is not None and np.ndim(self.speed):
      raise InputError("got several speeds for the points of a root path; give times in their place")
    speeds = np.ravel(0.0 if self.speed is None else self.speed)
    if len(wrong := speeds[(speeds != 0) & ~(speeds >= _SLOWEST)]):
      raise InputError(f"got the speed {wrong[0]:g} of a root path, expected 0, or {_SLOWEST:g} or more "
                       "metres a second")


@dataclasses.dataclass(frozen=True, eq=False)
class Keyframe(Constraint):
  """Whole-body pose, joints (22, 3), at a time.

  place: "anywhere" moves the pose to the body's position and heading at that time, or to the given path, and keeps its
  height; "world" keeps the joints' positions. slack: seconds by which the pose may be met earlier or later. strength:
  share of the way from the motion as sampled to the pose, above 0 and at most 1.
  """
  kind: ClassVar[str] = "keyframe"
  joints: Any
  time: float
  place: str = "anywhere"
  slack: float = 0.0
  strength: float = 1.0

  def __post_init__(self) -> None:
    _pose(self, "a keyframe")
    _tolerance(self, "a keyframe")
    _keep(self, "time", float(_times([self.time], "a keyframe")[0]))


@dataclasses.dataclass(frozen=True, eq=False)
class StartPose(Constraint):
  """The pose (22, 3) of the first frame; see `Keyframe`."""
  kind: ClassVar[str] = "start_pose"
  joints: Any
  place: str = "anywhere"

  def __post_init__(self) -> None:
    _pose(self, "a start pose")


@dataclasses.dataclass(frozen=True, eq=False)
class EndPose(Constraint):
  """The pose (22, 3) of the last frame; see `Keyframe`."""
  kind: ClassVar[str] = "end_pose"
  joints: Any
  place: str = "anywhere"

  def __post_init__(self) -> None:
    _pose(self, "an end pose")


@dataclasses.dataclass(frozen=True, eq=False)
class EffectorTarget(Constraint):
  """Positions (N, 3) of a hand, a foot, the head, the pelvis or any other joint at times (N,).

  relative_to: "world", or "root": the point on the floor below the pelvis, turned with the body, with x to its left, y
  up, z ahead. between: the joint also follows a smooth curve between the points. slack, strength: as in `Keyframe`; all
  times shift together.
  """
  kind: ClassVar[str] = "effector"
  joint: str
  times: Any
  positions: Any
  relative_to: str = "world"
  between: bool = False
  slack: float = 0.0
  strength: float = 1.0

  def __post_init__(self) -> None:
    joint_number(self.joint)
    _tolerance(self, f"a target of {self.joint}")
    _choice(self.relative_to, ("world", "root"), "relative_to")
    times = [self.times] if np.ndim(self.times) == 0 else self.times
    positions = [self.positions] if np.ndim(self.positions) == 1 else self.positions
    _keep(self, "times", _times(times, f"a target of {self.joint}"))
    _keep(self, "positions", _numbers(positions, f"the positions of {self.joint}", 2, (3,)))
    if len(self.times) != len(self.positions):
      raise InputError(f"got {len(self.times)} times and {len(self.positions)} positions of {self.joint}; give one for "
                       "each")


@dataclasses.dataclass(frozen=True, eq=False)
class Loop(Constraint):
  """The last frame has the pose of the first: the motion can be repeated."""
  kind: ClassVar[str] = "loop"


@dataclasses.dataclass(frozen=True, eq=False)
class InPlace(Constraint):
  """The root stays at one position on the floor, as on a treadmill."""
  kind: ClassVar[str] = "in_place"


@dataclasses.dataclass(frozen=True, eq=False)
class KeepParts(Constraint):
  """Body parts, of `PARTS`, that keep the motion of joints (T, 22, 3) at fps; the others are generated.

  spans: [(first second, last), ...] in which the others are generated; elsewhere the whole body is kept.
  """
  kind: ClassVar[str] = "keep_parts"
  joints: Any
  parts: Sequence[str]
  fps: float = 20.0
  spans: Any = None

  def __post_init__(self) -> None:
    _keep(self, "joints", _numbers(self.joints, "the motion whose parts are kept", 3, (3,)))
    if self.joints.shape[1] != 22:
      raise InputError(f"got a motion of {self.joints.shape[1]} joints to keep parts of, expected 22")
    _check_facing(self.joints, "the motion whose parts are kept")
    parts = (self.parts,) if isinstance(self.parts, str) else tuple(self.parts)
    for part in parts:
      _choice(part, PARTS, "a part")
    if not parts or set(parts) == set(PARTS):
      raise InputError(f"got {'all' if parts else 'none'} of the parts to be kept, expected some of "
                       f"{', '.join(PARTS)}")
    _keep(self, "parts", parts)
    if not (np.isscalar(self.fps) and 1 <= self.fps <= 1000):
      raise InputError(f"got {self.fps} frames a second of the motion whose parts are kept, expected 1 to 1000")
    _keep(self, "spans", _numbers(self.spans, "the spans of kept parts", 2, (2,)))
    if self.spans is not None and not (self.spans[:, 0] < self.spans[:, 1]).all():
      raise InputError("got a span of kept parts that ends before it begins")


KINDS: dict[str, type[Constraint]] = {
    kind.kind: kind for kind in (RootPath, Keyframe, EffectorTarget, StartPose, EndPose, Loop, InPlace, KeepParts)}


def joint_number(name: str) -> int:
  """Index of one of the 22 joints, by its name or an alias such as left_hand. Raises InputError for other names."""
  name = KIMODO_JOINTS.get(name, name) if isinstance(name, str) else str(name)
  if name not in JOINTS:
    raise InputError(f"got the joint {name[:40]!r}{did_you_mean(name, JOINTS)}, expected one of {', '.join(JOINTS)}")
  return JOINTS[name]


def _keep(constraint: Constraint, name: str, value: Any) -> None:
  object.__setattr__(constraint, name, value)


def _choice(value: Any, known: Sequence[str], what: str) -> None:
  if value not in known:
    raise InputError(f"got {str(value)[:40]!r} as {what}, expected one of {', '.join(known)}")


def _tolerance(constraint: Any, what: str) -> None:
  for name, low, high in (("slack", 0.0, LONGEST_SLACK), ("strength", LEAST_STRENGTH, 1.0)):
    value = _numbers(getattr(constraint, name), f"the {name} of {what}", None)
    if value is None or value.ndim or not low <= value <= high:
      raise InputError(f"got the {name} {str(getattr(constraint, name))[:40]} of {what}, expected a number from "
                       f"{low:g} to {high:g}")
    _keep(constraint, name, float(value))


def _pose(constraint: Any, what: str) -> None:
  _choice(constraint.place, ("anywhere", "world"), "the place of a pose")
  joints = _numbers(constraint.joints, f"the joints of {what}", 2, (3,))
  if len(joints) != 22:
    raise InputError(f"got {len(joints)} joints of {what}, expected 22")
  _check_facing(joints[None], f"the joints of {what}")
  _keep(constraint, "joints", joints)


def _check_facing(joints: np.ndarray, what: str) -> None:
  """Raises InputError for bodies (T, 22, 3) without a heading, which follows from the lines through hips and shoulders.
  """
  with np.errstate(invalid="ignore"):
    unknown = ~np.isfinite(facing(joints)).all(-1)
  if unknown.any():
    frame = f" in frame {int(unknown.argmax())}" if len(joints) > 1 else ""
    raise InputError(f"got {what} with left and right hip and shoulder in one place, or one above the other{frame}, so "
                     "that the body faces nowhere; move them apart")


def _times(values: Any, what: str) -> Any:
  times = _numbers(values, f"the times of {what}", 1)
  if times is not None and ((times < 0).any() or (np.diff(times) <= 0).any()):
    raise InputError(f"got times of {what} that are below 0 or do not rise, expected seconds such as 0, 1.5, 3")
  return times


def _numbers(values: Any, what: str, dims: int | None, last: Sequence[int] = ()) -> Any:
  """Converts to a finite float64 array of `dims` dimensions (None: 0 or 1); None stays None."""
  if values is None:
    return None
  try:
    array = np.asarray(values, np.float64)
  except (TypeError, ValueError, OverflowError):
    raise InputError(f"got {what} that are no numbers, or not as many in every row") from None
  if (array.ndim > 1 if dims is None else array.ndim != dims) or not array.size or last and array.shape[-1] not in last:
    shape = " or ".join(f"(..., {count})" for count in last) or "a list"
    raise InputError(f"got {what} of shape {array.shape}, expected {shape}")
  bad = ~np.isfinite(array) | (np.abs(array) > _FARTHEST)
  if bad.any():
    where = int(np.argwhere(bad)[0][0]) if array.ndim else 0
    raise InputError(f"got {what} with {array[bad].flat[0]:g} in number {where}, expected finite numbers below "
                     f"{_FARTHEST:g}")
  return array
