"""Constraints of a stream that runs: they lie ahead of what is decided, and what is decided never moves."""
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control import paths
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.constraints import Constraint, EffectorTarget, Keyframe, RootPath
from motion_jax.control.signal import ControlSignal
from motion_jax.utils.errors import InputError
from motion_studio.controlled import WALK
from motion_studio.server.limits import Limits

_NEAR = 0.3   # metres from the body at which a path is taken to begin where it stands
_FINE = 0.05  # metres between two places of a path by which a body on it is found
_LOOK = 1.5   # metres of a path beyond where a body was on it, within which it is looked for
_BACK = 0.4   # metres of a path on which a body beside it comes back to it
_LEFT = 0.1   # metres of a path that need not be gone along any more


def check(control: Sequence[Constraint]) -> None:
  """Raises InputError for constraints that a motion without an end cannot have."""
  for one in control:
    if not isinstance(one, RootPath | Keyframe | EffectorTarget):
      raise InputError(f"got {one.kind} for a stream, expected root_path, keyframe or effector: a stream has no end, "
                       "and its beginning is past")
    if isinstance(one, RootPath) and one.points is None:
      raise InputError("got a root_path without points for a stream; give the points to go through")
    if isinstance(one, EffectorTarget) and one.relative_to == "root":
      raise InputError("got an effector relative to the root for a stream; say where it is in the world")
    if isinstance(one, Keyframe) and one.place == "anywhere" and not any(isinstance(way, RootPath) for way in control):
      raise InputError("got a keyframe that may be anywhere for a stream; give it the place \"world\", or a path "
                       "beside it")


def signal_of(control: Sequence[Constraint], at: float | None, decided: int, place: tuple[float, float],
              ends: int | None, fps: float, limits: Limits) -> ControlSignal | None:
  """The `ControlSignal` (1, T) of constraints whose times count from second `at` of a stream, or from the first frame
  that is not decided; it begins with the stream. None asks for nothing.

  A path without times is gone along from there at its speed, or at walking pace; without `at` it begins where the body
  is, place (x, z). ends: the frames that the stream has.
  """
  if not control:
    return None
  first = decided if at is None else round(at * fps)
  if first - decided > limits.seconds * fps:
    raise InputError(f"got control from {at:g} s on of a stream that is at {decided / fps:.1f} s, expected it to begin "
                     f"within {limits.seconds:g} s")
  control = [_from_here(one, place if at is None else None) for one in control]
  count = max(_last(one, fps) for one in control) + 1
  if count > limits.seconds * fps:
    raise InputError(f"got control of {count / fps:.0f} s, expected at most {limits.seconds:g} s at once")
  if ends is not None and first + count > ends:
    raise InputError(f"got control up to {(first + count) / fps:.1f} s of a stream that ends at {ends / fps:.1f} s")
  found = compile(control, count, fps)
  for one in control:
    if isinstance(one, Keyframe) and not found.given[0, _last(one, fps), 1:].any():
      raise InputError(f"got a keyframe at {one.time:g} s that may be anywhere, where no path says where the body is; "
                       "give it the place \"world\"")
  # In numpy: of each step another length would be compiled.
  return jax.tree.map(lambda a: np.pad(np.asarray(a), ((0, 0), (first, 0)) + ((0, 0),) * (np.ndim(a) - 2)),
                      clip_to_feasible(found, fps, warn=False))


def _last(one: Any, fps: float) -> int:
  """The last frame of a constraint."""
  if isinstance(one, RootPath) and one.times is None:
    return int(paths.length(one.points[:, [0, -1]]) / one.speed * fps + 1e-9)
  return int(np.floor((one.time if isinstance(one, Keyframe) else one.times[-1]) * fps + 0.5 + 1e-9))


def _from_here(one: Constraint, place: tuple[float, float] | None) -> Constraint:
  """A path without times as one with a speed, that begins at place (x, z)."""
  if not isinstance(one, RootPath) or one.times is not None:
    return one
  points, heading = one.points, one.heading
  if place is not None:
    start = np.array([place[0], *points[0, 1:-1], place[1]])
    near = len(points) > 1 and np.linalg.norm((points[0] - start)[[0, -1]]) < _NEAR
    points = np.concatenate([start[None], points[int(near):]])
    heading = np.concatenate([heading[:1], heading[int(near):]]) if np.ndim(heading) else heading
  return dataclasses.replace(one, points=points, heading=heading, speed=one.speed or WALK)


class Course:
  """A path without times, which a body goes along as fast as it goes: what is left of it from block to block."""

  def __init__(self, path: RootPath, place: tuple[float, float]) -> None:
    self._path = _from_here(path, place)
    length = paths.length(self._path.points)
    self._curve = paths.evenly(self._path.points, np.linspace(0, 1, max(round(length / _FINE), 1) + 1))
    self._at = 0

  @staticmethod
  def from_constraints(control: Sequence[Constraint] | None, at: float | None, place: tuple[float, float]
                       ) -> "Course | None":
    """The course of constraints that are one path alone, with neither times nor several headings; else None."""
    one = control[0] if control and len(control) == 1 and at is None else None
    free = isinstance(one, RootPath) and one.points is not None and one.times is None and one.between
    return Course(one, place) if free and not np.ndim(one.heading) else None

  def rest(self, place: tuple[float, float]) -> RootPath | None:
    """What is left for a body at place (x, z), which never goes back on it; None once it has come to its end."""
    near = self._curve[self._at:self._at + round(_LOOK / _FINE) + 1, [0, -1]]
    self._at += int(np.linalg.norm(near - place, axis=-1).argmin())
    if self._at >= len(self._curve) - 1 - round(_LEFT / _FINE):
      return None
    ahead = self._curve[self._at + round(_BACK / _FINE)::round(_BACK / _FINE)]
    start = np.array([place[0], *self._curve[self._at, 1:-1], place[1]])
    return dataclasses.replace(self._path, points=np.concatenate([start[None], ahead, self._curve[-1:]]))
