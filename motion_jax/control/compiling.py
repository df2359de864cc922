"""Compile constraints to a `ControlSignal`, and clip it to feasible targets."""
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.control import paths
from motion_jax.control.constraints import (
  Constraint,
  EffectorTarget,
  EndPose,
  Keyframe,
  RootPath,
  StartPose,
  joint_number,
)
from motion_jax.control.signal import NUM_JOINTS, ControlSignal, rotate_about_y
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.shapes import Num
from motion_jax.utils.errors import InputError

_SAME = 2e-3  # metres: tolerance between two targets of one joint in one frame
FASTEST = 7.0   # metres per second: a sprint
_MISSED = 0.01  # metres: a larger distance from a target is a warning
_JUMP = 0.4     # metres: height of the highest jump
_CLIMB = 3.0    # metres: largest additional height of a whole pose, on stairs, a table, a ladder
_SUNK = 0.02    # metres: depth below the floor that still counts as on it


def compile(constraints: Sequence[Constraint], frames: int, fps: float = 20.0,
            joints: Num[np.ndarray, "t j 3"] | None = None) -> ControlSignal:
  """Compiles paths, poses and targets to a `ControlSignal` (1, frames) of numpy arrays.

  joints (frames, 22, 3): the motion so far, which positions poses with place "anywhere" and targets relative to the
  root. Without it these are omitted, except for a pose at the start and poses on a path. Raises InputError for a time
  after the end, and for two poses or two positions of a joint in one frame.
  """
  sheet = _Sheet(frames, fps, joints)
  for constraint in constraints:
    if isinstance(constraint, RootPath):
      _path(sheet, constraint)
  for constraint in constraints:
    if isinstance(constraint, EffectorTarget):
      _target(sheet, constraint)
  poses: dict[int, str] = {}
  for constraint in constraints:
    if isinstance(constraint, Keyframe | StartPose | EndPose):
      frame = (0 if isinstance(constraint, StartPose) else frames - 1 if isinstance(constraint, EndPose) else
               sheet.frames_of([constraint.time], constraint.kind)[0])
      if frame in poses:
        raise InputError(f"got two poses at {frame / fps:.2f} s (frame {frame}): {poses[frame]} and "
                         f"{constraint.kind}; give one")
      poses[frame] = constraint.kind
      _pose(sheet, constraint, frame)
  return ControlSignal(sheet.positions[None].astype(np.float32), sheet.given[None],
                       sheet.heading[None].astype(np.float32), sheet.heading_given[None])


class _Sheet:
  """The targets of one motion compiled so far."""

  def __init__(self, frames: int, fps: float, joints: Any) -> None:
    self.count, self.fps, self.joints = frames, fps, joints
    self.positions, self.given = np.zeros((frames, NUM_JOINTS, 3)), np.zeros((frames, NUM_JOINTS, 3), bool)
    self.heading, self.heading_given = np.zeros(frames), np.zeros(frames, bool)
    self.way: Any = None  # direction (frames,) of a path without headings

  def frames_of(self, times: Any, kind: str) -> np.ndarray:
    """The frames nearest to times. Raises InputError for a time after the end."""
    frames = np.floor(np.asarray(times) * self.fps + 0.5 + 1e-9).astype(int)
    if (frames >= self.count + 1).any() or (frames > self.count - 1).any() and not self._is_end(times):
      late = np.max(times)
      raise InputError(f"got {kind} at {late:g} s (frame {frames.max()}), the motion ends at "
                       f"{(self.count - 1) / self.fps:g} s (frame {self.count - 1}); make it "
                       "longer, or set an earlier time")
    return np.minimum(frames, self.count - 1)

  def _is_end(self, times: Any) -> bool:
    """Whether the last time is the motion's length: "at 3 s" means the last frame of a motion of 3 s."""
    return bool(np.max(times) * self.fps <= self.count + 1e-6)

  def put(self, frame: int, joint: int, axes: Sequence[int], place: Any, kind: str) -> None:
    axes = list(axes)
    before = self.given[frame, joint, axes]
    if (before & (np.abs(self.positions[frame, joint, axes] - place) > _SAME)).any():
      raise InputError(f"got two places of {HUMANML3D.joints[joint]} at {frame / self.fps:.2f} s (frame {frame}), the "
                       f"second by {kind}; give one")
    self.positions[frame, joint, axes] = place
    self.given[frame, joint, axes] = True

  def body(self, frame: int) -> tuple[Any, float] | None:
    """(x and z, heading) of the body in a frame, from its targets or else the motion so far; None if unknown."""
    spot = self.joints[frame, 0, [0, 2]] if self.joints is not None else np.zeros(2) if frame == 0 else None
    if self.given[frame, 0, [0, 2]].all():
      spot = self.positions[frame, 0, [0, 2]]
    turn = angle_of(self.joints[frame:frame + 1])[0] if self.joints is not None else 0.0 if frame == 0 else None
    if self.heading_given[frame]:
      turn = self.heading[frame]
    elif self.joints is None and self.way is not None and np.isfinite(self.way[frame]):
      turn = self.way[frame]
    return None if spot is None or turn is None else (spot, turn)


def angle_of(joints: Num[np.ndarray, "t j 3"]) -> np.ndarray:
  """Headings (T,) of bodies (T, 22, 3), radians about +Y from +Z to +X, without jumps by whole turns."""
  ahead = facing(np.asarray(joints, np.float64))
  return np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2]))


def _path(sheet: _Sheet, path: RootPath) -> None:
  points, headings, frames = _laid_out(sheet, path)
  axes = (0, 2) if points.shape[-1] == 2 else (0, 1, 2)
  for frame, place in zip(frames, points):
    sheet.put(int(frame), 0, axes, place, path.kind)
  if headings is not None:
    sheet.heading[frames], sheet.heading_given[frames] = headings, True
  elif len(frames) > 2:
    step = np.gradient(points[:, [0, -1]], axis=0)
    sheet.way = np.full(sheet.count, np.nan)
    moves = np.linalg.norm(step, axis=-1) * sheet.fps > 0.1
    sheet.way[frames[moves]] = np.arctan2(step[moves, 0], step[moves, 1])


def _laid_out(sheet: _Sheet, path: RootPath) -> tuple[np.ndarray, Any, np.ndarray]:
  """(points (N, 2 or 3), headings (N,) or None, frames (N,)) of a path."""
  clock, each = np.arange(sheet.count) / sheet.fps, lambda value, n: np.broadcast_to(value, n)
  if path.points is None:
    times = np.array([0.0]) if path.times is None else path.times
    sheet.frames_of(times, path.kind)
    speed, heading = (np.interp(clock, times, each(x, len(times))) for x in (path.speed, path.heading))
    step = (speed / sheet.fps)[:-1, None] * np.stack([np.sin(heading), np.cos(heading)], -1)[:-1]
    return np.append(np.zeros((1, 2)), np.cumsum(step, axis=0), axis=0), heading, np.arange(sheet.count)
  points, times, heading = path.points, path.times, path.heading
  if times is None:
    way = paths.length(points[:, [0, -1]])
    last = (sheet.count - 1) / sheet.fps if not path.speed else min(way / path.speed, (sheet.count - 1) / sheet.fps)
    share = clock * path.speed / max(way, 1e-9) if path.speed else clock / max(last, 1e-9)
    frames = np.flatnonzero(share <= 1 + 1e-9)
    dense = paths.evenly(points, np.minimum(share[frames], 1))
    if not path.between:
      frames = np.unique([np.linalg.norm(dense - point, axis=-1).argmin() for point in points])
      dense = dense[frames]
    headings = None if heading is None else each(heading, len(frames)) if not np.ndim(heading) else np.interp(
        np.linspace(0, 1, len(frames)), np.linspace(0, 1, len(points)), np.unwrap(heading))
    return dense, headings, frames
  frames = sheet.frames_of(times, path.kind)
  if not path.between:
    return points, None if heading is None else np.array(each(heading, len(points))), frames
  between = np.arange(frames[0], frames[-1] + 1)
  headings = None if heading is None else np.interp(between / sheet.fps, times,
                                                    np.unwrap(each(heading, len(points))))
  return paths.through(points, times, between / sheet.fps), headings, between


def _target(sheet: _Sheet, target: EffectorTarget) -> None:
  frames, places, joint = sheet.frames_of(target.times, target.kind), target.positions, joint_number(target.joint)
  if target.between and len(frames) > 1:
    places = paths.through(places, target.times, np.arange(frames[0], frames[-1] + 1) / sheet.fps)
    frames = np.arange(frames[0], frames[-1] + 1)
  for frame, place in zip(frames, places):
    if target.relative_to == "root":
      body = sheet.body(int(frame))
      if body is None or sheet.joints is None:
        continue
      spot, heading = body
      place = rotate_about_y(place, heading) + [spot[0], 0, spot[1]]
    sheet.put(int(frame), joint, (0, 1, 2), place, target.kind)


def _pose(sheet: _Sheet, pose: Any, frame: int) -> None:
  joints = pose.joints
  if pose.place == "anywhere":
    body = sheet.body(frame)
    if body is None:
      return
    spot, heading = body
    joints = rotate_about_y(joints - joints[0] * [1, 0, 1], heading - angle_of(joints[None])[0]) + [spot[0], 0, spot[1]]
  for joint in range(NUM_JOINTS):
    sheet.put(frame, joint, (0, 1, 2), joints[joint], pose.kind)
  sheet.heading[frame], sheet.heading_given[frame] = angle_of(joints[None])[0], True


# --- feasible targets --------------------------------------------------------------------------------------------


def clip_to_feasible(signal: ControlSignal, fps: float = 20.0, warn: bool = True) -> ControlSignal:
  """Clips a signal (1, T) to feasible targets: at most 7 m/s, within reach, not below the floor.

  A whole pose is moved up or down rigidly. warn: warn about the worst frame of each violation.
  """
  positions, given = np.array(signal.positions, np.float32), np.asarray(signal.given)
  said: list[str] = []
  whole = given[0].all((-1, -2))
  highest = _highest() + _CLIMB * whole[:, None]
  for bounds, over, words in ((highest, 1, "out of reach"), (np.full_like(highest, -_SUNK), -1,
                                                                          "below the floor")):
    beyond = np.where(given[0, ..., 1], over * (positions[0, ..., 1] - bounds), 0)
    if beyond.max() > 0:
      frame, joint = np.unravel_index(beyond.argmax(), beyond.shape)
      said.append(f"{HUMANML3D.joints[joint]} has a target at a height of {positions[0, frame, joint, 1]:.2f} m at "
                  f"{frame / fps:.2f} s (frame {frame}), {words}; the limit is {bounds[frame, joint]:.2f} m")
      positions[0, whole, :, 1] -= over * np.maximum(beyond[whole].max(-1, keepdims=True), 0)
      clipped = np.minimum(positions[0, ..., 1], bounds) if over > 0 else np.maximum(positions[0, ..., 1], bounds)
      positions[0, ..., 1] = np.where(given[0, ..., 1], clipped, positions[0, ..., 1])
  for joint in range(22):
    frames = np.flatnonzero(given[0, :, joint][:, [0, 2]].all(-1))
    said += _slowed(positions[0, :, joint], frames, fps, joint) if len(frames) > 1 else []
  if warn:
    for words in said:
      warnings.warn(words + "; the nearest feasible target is used", stacklevel=3)
  return signal.replace(positions=positions)


def _highest() -> np.ndarray:
  """Largest height (22,) of each joint: of an upright jumping body with stretched limbs."""
  chains = HUMANML3D.chains
  leg = HUMANML3D.bone_lengths[list(chains[0])].sum()
  above = np.zeros(22)
  for chain in chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      above[joint] = above[parent] + HUMANML3D.bone_lengths[joint]
  return leg + above + _JUMP


def _slowed(places: np.ndarray, frames: np.ndarray, fps: float, joint: int) -> list[str]:
  """Limits the speed between targets (T, 3) in the given frames, in place; returns warnings."""
  fastest = FASTEST * (1.0 if joint == 0 else 2.5)  # hands and feet are faster
  ground = [0, 2]
  steps = np.linalg.norm(np.diff(places[frames][:, ground].astype(np.float64), axis=0), axis=-1)
  speed = steps * fps / np.diff(frames)
  if not (speed > fastest).any():
    return []
  worst = int(speed.argmax())
  for before, now in zip(frames[:-1], frames[1:]):
    away = places[now, ground] - places[before, ground]
    most = fastest * (now - before) / fps
    places[now, ground] = places[before, ground] + away * min(1.0, most / max(float(np.linalg.norm(away)), 1e-9))
  return [f"{HUMANML3D.joints[joint]} has to move at {speed[worst]:.1f} m/s to its target at "
          f"{frames[worst + 1] / fps:.2f} s (frame {frames[worst + 1]}), more than {fastest:g} m/s"]


def warn_missed(signal: ControlSignal, off: np.ndarray, fps: float = 20.0) -> None:
  """Warns about the largest distance `off` (T, 22), metres, of joints from their targets in a signal (1, T)."""
  if off.size and off.max() > _MISSED:
    frame, joint = np.unravel_index(off.argmax(), off.shape)
    count = int((off.max(1) > _MISSED).sum())
    warnings.warn(f"{HUMANML3D.joints[joint]} misses its target at {frame / fps:.2f} s (frame {frame}) by "
                  f"{off[frame, joint]:.2f} m, the worst of {count} frame(s): the constraints contradict one another "
                  "or the lengths of the bones; the motion comes as near as it can", stacklevel=3)
