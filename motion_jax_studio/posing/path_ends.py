"""Paths of plans that end on the spot: "walks forward, then sits down" follows its path, and sits down at its end."""
import dataclasses
from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax.control import paths
from motion_jax.control.constraints import Constraint, RootPath
from motion_jax.models.results import Motion
from motion_jax_studio.language import Plan
from motion_jax_studio.language.lexicon import LOW
from motion_jax_studio.language.path_shapes import is_gait
from motion_jax_studio.planning import durations

_FAR = 0.5      # metres; a longer path does not fit an action in place
_SLOW, _STOPS = 0.3, 1.5  # metres a second of a body that has stopped, and seconds within which it stops
_POINTS = 40    # way points of a path with times


def moving_segments(plan: Plan) -> int:
  """Number of segments before the final ones that stay in place; all of them if none walks or runs."""
  segments = list(plan.segments)
  count = len(segments)
  while count and _stays(segments[count - 1]):
    count -= 1
  goes = any(is_gait(segment.action.verb) for segment in segments[:count])
  return count if goes else len(segments)


def frames_after_path(planner: Any, plan: Plan) -> int:
  """Usual frames of the segments after the path's end."""
  return sum(durations.usual_frames(planner, plan)[moving_segments(plan):])


def with_stop(constraints: Sequence[Constraint], motion: Motion, plan: Plan) -> list[Constraint]:
  """The constraints, with times for a path that has none: it ends when the body stops after its moving segments."""
  count = moving_segments(plan)
  if count == len(plan.segments) or len(motion.captions) != len(plan.segments):
    return list(constraints)
  border = round(motion.captions[count - 1].end * motion.fps)
  speed = Body(np.asarray(motion.joints, np.float64), motion.fps).speed[border:border + round(_STOPS * motion.fps)]
  stop = border + int(np.argmax(speed < _SLOW)) if (speed < _SLOW).any() else border
  stop = max(min(stop, motion.num_frames - 1), 1)
  return [_with_times(constraint, motion, stop) if is_free(constraint) else constraint for constraint in constraints]


def is_free(constraint: Constraint) -> TypeGuard[RootPath]:
  """Whether a constraint is a path without times."""
  return isinstance(constraint, RootPath) and constraint.points is not None and constraint.times is None and (
      constraint.between and not np.ndim(constraint.heading))


def path_note(plan: Plan, constraints: Sequence[Constraint]) -> str:
  """A note on an action in place, such as sitting down, that a path would carry along; "" if there is none."""
  far = any(is_free(constraint) and paths.length(constraint.points[:, [0, -1]]) > _FAR for constraint in constraints)
  if not far or moving_segments(plan) < len(plan.segments):
    return ""
  low = next((action for action in plan.actions if action.verb in LOW), None)
  return "" if low is None else (f"the body goes along its path all the time, so {low.words!r} is done on the way; say "
                                 f"\"a person walks, then {low.words}\" to do it at the end of the path")


def _stays(segment):
  return segment.is_pause or all(action.slots.stays for action in segment.actions)


def _with_times(path, motion, stop):
  """The path with times: followed up to frame `stop` at the pace of the motion, which slows down there."""
  steps = np.linalg.norm(np.diff(motion.joints[:stop + 1, 0, ::2], axis=0), axis=-1)
  covered = np.concatenate([[0.0], np.cumsum(steps + 1e-6)])
  frames = np.unique(np.linspace(0, stop, min(_POINTS, stop + 1)).round().astype(int))
  return dataclasses.replace(path, points=paths.evenly(path.points, covered[frames] / covered[-1]),
                             times=frames / motion.fps, speed=None)
