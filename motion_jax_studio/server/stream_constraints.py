"""Constraints of a running stream: they apply to frames that are not decided yet."""
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
from motion_jax_studio.constraining import WALK
from motion_jax_studio.server.limits import Limits

_NEAR = 0.3   # metres: a path that starts closer to the body starts at the body
_FINE = 0.05  # metres between sampled places of a path
_SEARCH = 1.5  # metres of a path, ahead of the body's last place on it, that are searched for its next one
_BACK = 0.4   # metres of a path in which a body that has left it returns to it
_LEFT = 0.1   # metres; a path with less than this left is complete


def check(control: Sequence[Constraint]) -> None:
  """Raises InputError for constraints that an endless motion cannot have."""
  for constraint in control:
    if not isinstance(constraint, RootPath | Keyframe | EffectorTarget):
      raise InputError(f"got {constraint.kind} for a stream, expected root_path, keyframe or effector: a stream has no "
                       "end, and its beginning is past")
    if isinstance(constraint, RootPath) and constraint.points is None:
      raise InputError("got a root_path without points for a stream; give the points to go through")
    if isinstance(constraint, EffectorTarget) and constraint.relative_to == "root":
      raise InputError("got an effector relative to the root for a stream; say where it is in the world")
    if isinstance(constraint, Keyframe) and constraint.place == "anywhere" and not (
        any(isinstance(other, RootPath) for other in control)):
      raise InputError("got a keyframe that may be anywhere for a stream; give it the place \"world\", or add "
                       "a path")


def signal_of(control: Sequence[Constraint], at: float | None, decided: int, place: tuple[float, float],
              ends: int | None, fps: float, limits: Limits) -> ControlSignal | None:
  """The `ControlSignal` (1, T) of constraints, from the first frame of the stream on; None without constraints.

  Their times count from second `at` of the stream, or from the first undecided frame. A path without times is followed
  at its speed or at walking pace; without `at` it starts at the body's place (x, z). ends: length of the stream in
  frames, or None.
  """
  if not control:
    return None
  first = decided if at is None else round(at * fps)
  if first - decided > limits.seconds * fps:
    raise InputError(f"got control from {at:g} s on of a stream that is at {decided / fps:.1f} s, expected it to begin "
                     f"within {limits.seconds:g} s")
  control = [_from_here(constraint, place if at is None else None) for constraint in control]
  count = max(_last(constraint, fps) for constraint in control) + 1
  if count > limits.seconds * fps:
    raise InputError(f"got control of {count / fps:.0f} s, expected at most {limits.seconds:g} s at once")
  if ends is not None and first + count > ends:
    raise InputError(f"got control up to {(first + count) / fps:.1f} s of a stream that ends at {ends / fps:.1f} s")
  signal = compile(control, count, fps)
  for constraint in control:
    if isinstance(constraint, Keyframe) and not signal.given[0, _last(constraint, fps), 1:].any():
      raise InputError(f"got a keyframe at {constraint.time:g} s that may be anywhere, where no path says where the "
                       "body is; give it the place \"world\"")
  # In numpy: JAX would compile each length.
  return jax.tree.map(lambda a: np.pad(np.asarray(a), ((0, 0), (first, 0)) + ((0, 0),) * (np.ndim(a) - 2)),
                      clip_to_feasible(signal, fps, warn=False))


def _last(constraint: Any, fps: float) -> int:
  """The last frame of a constraint."""
  if isinstance(constraint, RootPath) and constraint.times is None:
    return int(paths.length(constraint.points[:, [0, -1]]) / constraint.speed * fps + 1e-9)
  seconds = constraint.time if isinstance(constraint, Keyframe) else constraint.times[-1]
  return int(np.floor(seconds * fps + 0.5 + 1e-9))


def _from_here(constraint: Constraint, place: tuple[float, float] | None) -> Constraint:
  """The constraint; a path without times gets a speed, and starts at `place` (x, z) unless that is None."""
  if not isinstance(constraint, RootPath) or constraint.times is not None:
    return constraint
  points, heading = constraint.points, constraint.heading
  if place is not None:
    start = np.array([place[0], *points[0, 1:-1], place[1]])
    near = len(points) > 1 and np.linalg.norm((points[0] - start)[[0, -1]]) < _NEAR
    points = np.concatenate([start[None], points[int(near):]])
    heading = np.concatenate([heading[:1], heading[int(near):]]) if np.ndim(heading) else heading
  return dataclasses.replace(constraint, points=points, heading=heading, speed=constraint.speed or WALK)


class Course:
  """A path without times that adapts to the body's speed: the part ahead of the body is set again for every block."""

  def __init__(self, path: RootPath, place: tuple[float, float]) -> None:
    self._path = _from_here(path, place)
    length = paths.length(self._path.points)
    self._curve = paths.evenly(self._path.points, np.linspace(0, 1, max(round(length / _FINE), 1) + 1))
    self._at = 0

  @staticmethod
  def from_constraints(control: Sequence[Constraint] | None, at: float | None, place: tuple[float, float]
                       ) -> "Course | None":
    """The course of a single path that has no times and at most one heading; None for other constraints."""
    path = control[0] if control and len(control) == 1 and at is None else None
    free = isinstance(path, RootPath) and path.points is not None and path.times is None and path.between
    return Course(path, place) if free and not np.ndim(path.heading) else None

  def rest(self, place: tuple[float, float]) -> RootPath | None:
    """The part of the path ahead of a body at `place` (x, z), never backwards; None at its end."""
    near = self._curve[self._at:self._at + round(_SEARCH / _FINE) + 1, [0, -1]]
    self._at += int(np.linalg.norm(near - place, axis=-1).argmin())
    if self._at >= len(self._curve) - 1 - round(_LEFT / _FINE):
      return None
    ahead = self._curve[self._at + round(_BACK / _FINE)::round(_BACK / _FINE)]
    start = np.array([place[0], *self._curve[self._at, 1:-1], place[1]])
    return dataclasses.replace(self._path, points=np.concatenate([start[None], ahead, self._curve[-1:]]))
