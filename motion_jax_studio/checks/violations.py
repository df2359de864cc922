"""Prompt checks: how far the joints of a motion are from the requirements of its prompt.

Samples with a violation are resampled (best of n). `analysis.events` detects kicks, punches, jumps, hops, squats, bows,
waves, turns and walks backward, with side and number; sitting, standing still, dancing in place and the speed of a run
are measured here, shape and pace of a path in `path_violations`. The detection of events is uncertain near its limits,
so a motion with a violation may still be a good one. Every function takes joints of any span: those of one action, or
the new frames of an edit. `reports.unmet_requirements` describes violations in words.
"""
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from motion_jax.analysis.events import PUNCH, Event, feet_up, find_events, punch_speed
from motion_jax.analysis.signals import JOINT, SIDES, Body
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.shapes import Num
from motion_jax_studio.checks import posture_violations
from motion_jax_studio.checks.path_violations import path_violation
from motion_jax_studio.language.path_shapes import KINDS, PathShape
from motion_jax_studio.language.requirements import COUNTED, Requirement

# Limits. Speeds are metres per second, heights relative to that of the standing pelvis.
_FASTEST_RUN = 4.7  # of the fastest second; of 330 captured runs the fastest has 4.5
_DANCE_DISTANCE = 1.2  # metres from beginning to end; three quarters of 142 captured dances stay within it
_BACKWARD_SPEED, _BACKWARD_SHARE = 0.25, 0.7  # of a walk backward, and its least share of the whole speed
_BACKWARD_SECONDS, _STEP_BACK_SECONDS = 1.2, 0.35  # of a walk backward, and of one or two steps
_SWAY = 0.35  # speed of hands, feet or head of a body that stands still
_GESTURE = 1.0  # of those in a gesture
_SEATED_HEIGHT = 0.89  # of the pelvis on a high stool
_THIGH_ANGLE = 45.0  # degrees of both thighs from upright in a seat; captured ones have 53 and more
_STANDING_HEIGHT = 0.92  # of the pelvis after getting up
_HOLD_SECONDS = 0.5  # of sitting, and of standing after getting up
_LEAVES_SEAT = 0.4  # share of the way up from the lowest point at which a seated body counts as getting up
_CLIMB = 0.25  # metres up or down on stairs
_SIDEWAYS_SECONDS = 0.8  # of a walk to a side
_RAISED_SECONDS = 0.3  # of a hand over its shoulder
_LYING_HEIGHT = 0.4  # metres of the head over the ground
_WEAK_KICK = 0.4  # violation of a lifted foot that is no detected kick, if kicks are counted


def can_be_checked(model: Any) -> bool:
  """Whether requirements can be measured on motions of a model, which needs HumanML3D's skeleton of 22 joints."""
  return model.stats.layout.skeleton is HUMANML3D


def violation_score(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0
                    ) -> float:
  """The sum of `violations` of joints (T, 22, 3): 0 if all requirements are met."""
  return float(sum(violations(joints, requirements, fps)))


def violations(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0
               ) -> list[float]:
  """How far joints (T, 22, 3) are from each requirement; 0 if it is met.

  1 for each missing event and, if events are counted, for each surplus one. Near misses are less than 1: a dance that
  wanders (by its distance), a fist that is too slow for a punch (by its speed), a turn (by its error in degrees).
  """
  if not requirements:
    return []
  body = Body(np.asarray(joints, np.float64), fps)
  events = functools.cache(lambda: find_events(joints, fps))
  return [violation(body, events, requirement) for requirement in requirements]


def violation(body: Body, events: Callable[[], Sequence[Event]], requirement: Requirement) -> float:
  """How far a body is from one requirement. events() -> its events, called only if needed."""
  if requirement.kind in KINDS:
    return _of_path(body, requirement)
  if requirement.kind in _MEASURES:
    return float(_MEASURES[requirement.kind](body))
  if requirement.kind in _SIDED_MEASURES:
    return float(_SIDED_MEASURES[requirement.kind](body, requirement))
  return _event_violation(body, events(), requirement)


def _of_path(body, requirement):
  return path_violation(body, PathShape(requirement.kind, requirement.side))


def events_of(events: Sequence[Event], requirement: Requirement) -> list[Event]:
  """The events of a requirement's kind and side."""
  kind, side = requirement.kind, requirement.side
  return [event for event in events if event.kind == kind and (side in ("", event.side, event.way)
                                                              or event.side == "both")]


def number_of(events: Sequence[Event], kind: str) -> int:
  """Number of repetitions in events of one kind."""
  return sum(max(event.count, 1) if kind in COUNTED else 1 for event in events)


def _event_violation(body, events, requirement):
  kind, side, times, counted, degrees = requirement
  matching = events_of(events, requirement)
  number = number_of(matching, kind)
  missed = float(abs(number - times) if counted else max(times - number, 0))
  if kind == "kick" and counted:  # viewers also count slow kicks and those with a bent leg
    missed += _WEAK_KICK * abs(feet_up(body) - times)
  if degrees is not None and number >= times:
    total = abs(sum(event.amount for event in matching))
    missed += min(max(degrees[0] - total, total - degrees[1], 0.0) / 90, 0.9)
  if kind == "punch" and number < times:  # ranks motions without a punch by their fastest fist
    missed -= 0.9 * min(punch_speed(body, side) / PUNCH, 1.0)
  return missed


def excess_speed(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0) -> float:
  """Share by which joints (T, 22, 3) are too fast: a run above human speed, a walk of no stated pace above a quick one.

  Guidance raises speed: "runs fast" goes 5.6 m/s at `cmdm-small`'s own guidance and 4.4 without any, and feet slide
  more at higher speeds.
  """
  if len(joints) < 2:
    return 0.0
  body = Body(np.asarray(joints, np.float64), fps)
  return float(sum(_too_fast(body) if requirement.kind == "run" else _of_path(body, requirement)
                   for requirement in requirements if requirement.kind in ("run", "usual")))


def _too_fast(body):
  """Run: the fastest second below 4.7 m/s."""
  if body.num < 2:
    return 0.0
  steps = np.linalg.norm(np.diff(body.joints[:, 0, [0, 2]], axis=0), axis=-1) * body.fps
  second = min(round(body.fps), len(steps))
  return float(np.clip(np.convolve(steps, np.ones(second) / second, mode="valid").max() / _FASTEST_RUN - 1, 0.0, 0.9))


def _distance(body):
  """Metres on the ground between beginning and end."""
  return float(np.linalg.norm((body.joints[-1] - body.joints[0])[0, [0, 2]]))


def _dance_wanders(body):
  """Dance in place: the end within 1.2 m of the beginning."""
  return max(0.0, 1 - _DANCE_DISTANCE / max(_distance(body), 1e-9))


def _seconds_towards(body, degrees):
  """Seconds of a walk towards an angle from where the body faces, to the left of it."""
  way = body.heading + np.radians(degrees)
  along = (np.gradient(body.path, axis=0) * np.stack([np.sin(way), np.cos(way)], -1)).sum(-1) * body.fps
  return ((along > _BACKWARD_SPEED) & (along > _BACKWARD_SHARE * body.speed)).sum() / body.fps


def _not_backward(body, seconds=_BACKWARD_SECONDS):
  """Walk backward for this many seconds. Not taken from events, for walking forward and back is a single event."""
  return _seconds_towards(body, 180) < seconds


def _not_sideways(body, requirement):
  """Walk sideways: 0.8 s of it, to the given side or to any."""
  sides = [requirement.side] if requirement.side else SIDES
  longest = max(_seconds_towards(body, {"left": 90, "right": -90}[side]) for side in sides)
  return np.clip(1 - longest / _SIDEWAYS_SECONDS, 0.0, 1.0)


def _not_raised(body, requirement):
  """Raise a hand: the named one, both, or any is over its shoulder for 0.3 s; if counted, the other one is not."""
  side = requirement.side
  over = body.local("wrist", "shoulder")[..., 1] > 0
  seconds = over.sum(0) / body.fps if side != "both" else np.repeat(over.all(1).sum() / body.fps, 2)
  wanted = seconds.max() if side in ("", "both") else seconds[SIDES.index(side)]
  other = seconds[1 - SIDES.index(side)] if side in SIDES and requirement.counted else 0.0
  return np.clip(1 - wanted / _RAISED_SECONDS, 0.0, 1.0) + 0.5 * (other >= _RAISED_SECONDS)


def _not_lying(body):
  """Lie down: the head comes within 0.4 m of the ground."""
  height = (body.joints[:, JOINT["head"], 1] - body.floor).min()
  return np.clip(height - _LYING_HEIGHT, 0.0, 0.9)


def _no_step_back(body):
  return _not_backward(body, _STEP_BACK_SECONDS)


def _standing_height(body):
  """Height of the standing pelvis: its 90th percentile or, if larger, the estimate from the legs."""
  return max(np.percentile(body.joints[:, 0, 1], 90), posture_violations.upright_height(body))


def _moves(body):
  """Standing still: the share of time in which a hand, a foot or the head moves, plus the distance from start to end.
  Any gesture counts as a fifth of the time or more."""
  ends = body.joints[:, [10, 11, 15, 20, 21]]
  speed = np.linalg.norm(np.diff(ends, axis=0), axis=-1).max(1) * body.fps
  moves, away = float((speed > _SWAY).mean()) if len(speed) else 0.0, _distance(body)
  if (speed > _GESTURE).any():
    moves = max(moves, 0.2)
  return min((moves if moves > 0.1 else 0.0) + (away if away > 0.15 else 0.0), 1.0)


def _is_low(body):
  return body.joints[:, 0, 1] < _SEATED_HEIGHT * _standing_height(body)


def _sits(body):
  """Sitting (T,): the pelvis below 0.89 of standing height, both thighs 45 degrees or more from upright."""
  thighs = body.local("knee", "hip")
  return _is_low(body) & (-thighs[..., 1] < np.cos(np.radians(_THIGH_ANGLE)) * np.linalg.norm(thighs, axis=-1)).all(1)


def _last(body):
  return slice(-max(round(_HOLD_SECONDS * body.fps), 1), None)


def _never_sits(body):
  """Sit: in a seat for half a second."""
  return _sits(body).sum() < _HOLD_SECONDS * body.fps


def _not_seated(body):
  """Sit at the end: in a seat for the last half second, and not getting up in it."""
  height = body.joints[:, 0, 1]
  lowest, standing = float(height.min()), _standing_height(body)
  rises = float(height[_last(body)].max()) > lowest + _LEAVES_SEAT * max(standing - lowest, 0.0)
  return 0.5 * (rises or not _sits(body)[_last(body)].all())


def gets_up(body: Body) -> int:
  """The frame in which a body gets up after sitting down; the number of frames if it stays seated."""
  height, sits = body.joints[:, 0, 1], _sits(body)
  stood = int(np.argmin(sits))  # one that begins seated has not come to sit
  seat = stood + int(np.argmax(sits[stood:]))
  lowest = float(height[seat:].min())
  limit = max(lowest + _LEAVES_SEAT * (_standing_height(body) - lowest), float(height[seat]))
  return seat + int(np.argmax(height[seat:] > limit)) if sits[seat] and (height[seat:] > limit).any() else body.num


def _not_up(body):
  """Get up: once low, and the pelvis above 0.92 of standing height in the last half second."""
  return not (_is_low(body).any() and body.joints[_last(body), 0, 1].min() > _STANDING_HEIGHT * _standing_height(body))


def _foot_heights(body):
  """Smoothed height (T,) of the lowest foot joint, its maximum at the beginning and its mean at the end."""
  height = body.smooth(body.joints[:, [7, 8, 10, 11], 1].min(1), 0.2)
  few = max(round(_HOLD_SECONDS * body.fps), 1)
  return height, float(height[:few].max()), float(height[-few:].mean())


def _not_climbed(body):
  """Climbing: the feet must rise by `_CLIMB`, and not go far below their start."""
  height, start, _ = _foot_heights(body)
  below = start - float(height.min())
  return _missing_climb(float(height.max()) - start) + (min(below, 2.0) if below > _CLIMB / 2 else 0.0)


def _not_descended(body):
  """Going down: the feet must end `_CLIMB` below their start."""
  _, start, end = _foot_heights(body)
  return _missing_climb(start - end)


def _missing_climb(metres):
  return float(np.clip(1 - metres / _CLIMB, 0.0, 0.9))


# Measures of requirements that are not detected events.
_MEASURES = posture_violations.MEASURES | {
    "dance": _dance_wanders, "run": _too_fast, "still": _moves, "rise": _not_up, "seated": _not_seated,
    "sit": _never_sits, "step": _no_step_back, "walk": _not_backward, "ascend": _not_climbed,
    "descend": _not_descended, "lie": _not_lying}
_SIDED_MEASURES = posture_violations.SIDED_MEASURES | {"sideways": _not_sideways, "raise": _not_raised}
