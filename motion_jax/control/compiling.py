"""Constraints to arrays: where joints are to be, frame by frame, in the world that the constraints are given in."""
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Num

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
from motion_jax.control.signal import NUM_JOINTS, ControlSignal
from motion_jax.inputs.errors import InputError
from motion_jax.motion.skeleton import HUMANML3D, facing

_SAME = 2e-3  # metres by which two constraints may differ about one joint in one frame


def compile(constraints: Sequence[Constraint], frames: int, fps: float = 20.0,
            joints: Num[np.ndarray, "t j 3"] | None = None) -> ControlSignal:
  """The `ControlSignal` (1, frames) of paths, poses and targets, as numpy arrays.

  joints (frames, 22, 3): a motion so far. Poses that may be anywhere and targets that are relative to the root are laid
  where its body is; without it they are left out, but for a pose at the start and poses on a path. Raises InputError
  for a time behind the end, and for two poses or two places of a joint in one frame.
  """
  sheet = _Sheet(frames, fps, joints)
  for one in constraints:
    if isinstance(one, RootPath):
      _path(sheet, one)
  for one in constraints:
    if isinstance(one, EffectorTarget):
      _target(sheet, one)
  poses: dict[int, str] = {}
  for one in constraints:
    if isinstance(one, Keyframe | StartPose | EndPose):
      frame = (0 if isinstance(one, StartPose) else frames - 1 if isinstance(one, EndPose) else
               sheet.frames_of([one.time], one.kind)[0])
      if frame in poses:
        raise InputError(f"got two poses at {frame / fps:.2f} s (frame {frame}): {poses[frame]} and {one.kind}; give "
                         "one")
      poses[frame] = one.kind
      _pose(sheet, one, frame)
  return ControlSignal(sheet.positions[None].astype(np.float32), sheet.given[None],
                       sheet.heading[None].astype(np.float32), sheet.heading_given[None])


class _Sheet:
  """What is asked so far, of one motion."""

  def __init__(self, frames: int, fps: float, joints: Any) -> None:
    self.count, self.fps, self.joints = frames, fps, joints
    self.positions, self.given = np.zeros((frames, NUM_JOINTS, 3)), np.zeros((frames, NUM_JOINTS, 3), bool)
    self.heading, self.heading_given = np.zeros(frames), np.zeros(frames, bool)
    self.way: Any = None  # the direction (frames,) of a path where it gives no heading

  def frames_of(self, times: Any, kind: str) -> np.ndarray:
    """The frames nearest to times. Raises InputError for a time behind the end."""
    found = np.floor(np.asarray(times) * self.fps + 0.5 + 1e-9).astype(int)
    if (found >= self.count + 1).any() or (found > self.count - 1).any() and not self._is_end(times):
      late = np.max(times)
      raise InputError(f"got {kind} at {late:g} s (frame {found.max()}), the motion ends at "
                       f"{(self.count - 1) / self.fps:g} s (frame {self.count - 1}); make it longer, or ask earlier")
    return np.minimum(found, self.count - 1)

  def _is_end(self, times: Any) -> bool:
    """Whether the last time is the motion's length: people say "at 3 s" of the end of a motion of 3 s."""
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
    """(x and z, heading) of the body in a frame: as asked, else as in the motion so far; None where neither knows."""
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


def turned(points: Any, angle: Any) -> np.ndarray:
  """Points (..., 3) turned about +Y by angle, from +Z to +X."""
  points = np.asarray(points, np.float64)
  sin, cos = np.sin(angle), np.cos(angle)
  x, y, z = np.moveaxis(points, -1, 0)
  return np.stack([cos * x + sin * z, y, cos * z - sin * x], -1)


def _path(sheet: _Sheet, one: RootPath) -> None:
  points, headings, frames = _laid_out(sheet, one)
  axes = (0, 2) if points.shape[-1] == 2 else (0, 1, 2)
  for frame, place in zip(frames, points):
    sheet.put(int(frame), 0, axes, place, one.kind)
  if headings is not None:
    sheet.heading[frames], sheet.heading_given[frames] = headings, True
  elif len(frames) > 2:
    step = np.gradient(points[:, [0, -1]], axis=0)
    sheet.way = np.full(sheet.count, np.nan)
    moves = np.linalg.norm(step, axis=-1) * sheet.fps > 0.1
    sheet.way[frames[moves]] = np.arctan2(step[moves, 0], step[moves, 1])


def _laid_out(sheet: _Sheet, one: RootPath) -> tuple[np.ndarray, Any, np.ndarray]:
  """(points (N, 2 or 3), headings (N,) or None, frames (N,)) of a path."""
  clock, each = np.arange(sheet.count) / sheet.fps, lambda value, n: np.broadcast_to(value, n)
  if one.points is None:
    times = np.array([0.0]) if one.times is None else one.times
    sheet.frames_of(times, one.kind)
    speed, heading = (np.interp(clock, times, each(x, len(times))) for x in (one.speed, one.heading))
    step = (speed / sheet.fps)[:-1, None] * np.stack([np.sin(heading), np.cos(heading)], -1)[:-1]
    return np.append(np.zeros((1, 2)), np.cumsum(step, axis=0), axis=0), heading, np.arange(sheet.count)
  points, times, heading = one.points, one.times, one.heading
  if times is None:
    way = paths.length(points[:, [0, -1]])
    last = (sheet.count - 1) / sheet.fps if not one.speed else min(way / one.speed, (sheet.count - 1) / sheet.fps)
    share = clock * one.speed / max(way, 1e-9) if one.speed else clock / max(last, 1e-9)
    frames = np.flatnonzero(share <= 1 + 1e-9)
    dense = paths.evenly(points, np.minimum(share[frames], 1))
    if not one.between:
      frames = np.unique([np.linalg.norm(dense - point, axis=-1).argmin() for point in points])
      dense = dense[frames]
    headings = None if heading is None else each(heading, len(frames)) if not np.ndim(heading) else np.interp(
        np.linspace(0, 1, len(frames)), np.linspace(0, 1, len(points)), np.unwrap(heading))
    return dense, headings, frames
  frames = sheet.frames_of(times, one.kind)
  if not one.between:
    return points, None if heading is None else np.array(each(heading, len(points))), frames
  between = np.arange(frames[0], frames[-1] + 1)
  headings = None if heading is None else np.interp(between / sheet.fps, times,
                                                    np.unwrap(each(heading, len(points))))
  return paths.through(points, times, between / sheet.fps), headings, between


def _target(sheet: _Sheet, one: EffectorTarget) -> None:
  frames, places, joint = sheet.frames_of(one.times, one.kind), one.positions, joint_number(one.joint)
  if one.between and len(frames) > 1:
    places = paths.through(places, one.times, np.arange(frames[0], frames[-1] + 1) / sheet.fps)
    frames = np.arange(frames[0], frames[-1] + 1)
  for frame, place in zip(frames, places):
    if one.relative_to == "root":
      body = sheet.body(int(frame))
      if body is None or sheet.joints is None:
        continue
      spot, heading = body
      place = turned(place, heading) + [spot[0], 0, spot[1]]
    sheet.put(int(frame), joint, (0, 1, 2), place, one.kind)


def _pose(sheet: _Sheet, one: Any, frame: int) -> None:
  joints = one.joints
  if one.place == "anywhere":
    body = sheet.body(frame)
    if body is None:
      return
    spot, heading = body
    joints = turned(joints - joints[0] * [1, 0, 1], heading - angle_of(joints[None])[0]) + [spot[0], 0, spot[1]]
  for joint in range(NUM_JOINTS):
    sheet.put(frame, joint, (0, 1, 2), joints[joint], one.kind)
  sheet.heading[frame], sheet.heading_given[frame] = angle_of(joints[None])[0], True
