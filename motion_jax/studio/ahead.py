"""Constraints of a stream that runs: they lie ahead of what is decided, and what is decided never moves."""
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control import paths, signal
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import Constraint, EffectorTarget, Keyframe, RootPath
from motion_jax.control.limits import possible
from motion_jax.control.signal import ControlSignal
from motion_jax.inputs.errors import InputError
from motion_jax.models.controlled import WALK
from motion_jax.studio.limits import Limits

_NEAR = 0.3  # metres from the body at which a path is taken to begin where it stands


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
  return jax.tree.map(lambda a, b: np.concatenate([np.asarray(a), np.asarray(b)], axis=1), signal.none(1, first),
                      possible(found, fps, tell=False))


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
