"""Prompt checks: what a sentence requires that can be measured on joints, and how far a motion is from it.

`composed.generate` resamples a motion that violates a requirement. `motion.events` detects kicks, punches, jumps, hops,
squats, bows, waving hands, turns and walks backward, of which side they are, and how many; sitting, standing still,
dancing in place and the speed of a run are measured here, the shape of a path and its pace in `models.ways`. The rules
of events have zones of doubt, so a motion with a violation may still be a good one. Every function takes joints of any
span: those of one action, or of the frames that an edit made. `unmet.unmet_requirements` says the same in words.
"""
import functools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Num

from motion_jax.analysis.events import PUNCH, Event, feet_up, find_events, punch_speed
from motion_jax.analysis.signals import Body
from motion_studio.checks import path_shapes as ways
from motion_studio.language import parse
from motion_studio.language import requirements as needs
from motion_studio.language.requirements import COUNTED, Requirement, once  # noqa: F401

_FASTEST = 4.7  # metres a second, of the fastest second of whoever runs; of 330 captured clips the fastest has 4.5
_WANDERED = 1.2  # metres from beginning to end; three quarters of the 142 captured dances stay within that
_PACE, _STRAIGHT, _BACK = 0.25, 0.7, 1.2  # metres a second, share of the pace, and seconds of a walk backward
_STEP_BACK = 0.35  # seconds backward of a step or two at the least
_SWAY = 0.35  # metres a second of whoever stands still, at the most
_LOW, _WHILE = 0.89, 0.5  # of its height that a pelvis is at the most on a high stool, and for how many seconds
_THIGHS = 45.0  # degrees between either thigh and upright at the least of whoever sits; real ones have 53 and more
_STANDS = 1.1  # lengths of a leg that the pelvis of an upright body is up at the least; median of CMU 1.14, Bandai 1.18
_UP = 0.92  # of its height that a pelvis is at the least, so long, of somebody who got up
_STEP_UP = 0.25  # metres that a body climbs at the least
_HALF = 0.4  # of an action that is missed; what is like a kick and none counts so much where kicks are counted


def requirements_of(text: str) -> list[Requirement]:
  """Former way to `parse(text).requirements`."""
  return parse(text).requirements


def is_counted(prompt: str) -> bool:
  """Former way to `requirements.is_counted(parse(prompt).requirements)`."""
  return needs.is_counted(parse(prompt).requirements)


def violation_score(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0
                    ) -> float:
  """How far joints (T, 22, 3) are from what is required: 0 where all of it is met; the sum of `violations`."""
  return float(sum(violations(joints, requirements, fps)))


def violations(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0
               ) -> list[float]:
  """How far joints (T, 22, 3) are from each requirement, 0 where it is met.

  1 for each event that is missing, or too many where they are counted; less for what nearly shows: a dance that
  wanders, by how far it goes, a fist too slow for a punch, by its speed, a turn, by the degrees that it is off.
  """
  if not requirements:
    return []
  body = Body(np.asarray(joints, np.float64), fps)
  events = functools.cache(lambda: find_events(joints, fps))
  return [violation(body, events, one) for one in requirements]


def violation(body: Body, events: Callable[[], Sequence[Event]], requirement: Requirement) -> float:
  """How far a body is from one requirement. events: finds what the body does, once somebody needs it."""
  if requirement.kind in ways.KINDS:
    return ways.missed(body, ways.Way(requirement.kind, requirement.side))
  if requirement.kind in _MISSED:
    return float(_MISSED[requirement.kind](body))
  return _missed_events(body, events(), requirement)


def events_of(events: Sequence[Event], requirement: Requirement) -> list[Event]:
  """Those of the events that a requirement is about."""
  kind, side = requirement.kind, requirement.side
  return [event for event in events if event.kind == kind and (side in ("", event.side, event.way)
                                                              or event.side == "both")]


def number_of(events: Sequence[Event], kind: str) -> int:
  """How often something is done in events of this kind."""
  return sum(max(event.count, 1) if kind in COUNTED else 1 for event in events)


def _missed_events(body, events, requirement):
  kind, side, times, counted, degrees = requirement
  own = events_of(events, requirement)
  number = number_of(own, kind)
  missed = float(abs(number - times) if counted else max(times - number, 0))
  if kind == "kick" and counted:  # whoever watches counts slow and bent legs, too
    missed += _HALF * abs(feet_up(body) - times)
  if degrees is not None and number >= times:
    total = abs(sum(event.amount for event in own))
    missed += min(max(degrees[0] - total, total - degrees[1], 0.0) / 90, 0.9)
  if kind == "punch" and number < times:  # of motions without one, what comes nearest to it is the best
    missed -= 0.9 * min(punch_speed(body, side) / PUNCH, 1.0)
  return missed


def excess_speed(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0) -> float:
  """By which share joints (T, 22, 3) are too fast: a run faster than people run, or a walk of which no pace is said
  faster than one that is called quick.

  Guidance drives a body on: "runs fast" goes 5.6 m/s at `cmdm-small`'s own guidance, 4.4 without any, and feet slide
  the more the faster it goes.
  """
  if len(joints) < 2:
    return 0.0
  body = Body(np.asarray(joints, np.float64), fps)
  return float(sum(_too_fast(body) if one.kind == "run" else ways.missed(body, ways.Way(one.kind, one.side))
                   for one in requirements if one.kind in ("run", "usual")))


def _too_fast(body):
  if body.num < 2:
    return 0.0
  steps = np.linalg.norm(np.diff(body.joints[:, 0, [0, 2]], axis=0), axis=-1) * body.fps
  second = min(round(body.fps), len(steps))
  return float(np.clip(np.convolve(steps, np.ones(second) / second, mode="valid").max() / _FASTEST - 1, 0.0, 0.9))


def _away(body):
  """Metres between where it begins and where it ends."""
  return float(np.linalg.norm((body.joints[-1] - body.joints[0])[0, [0, 2]]))


def _wanders(body):
  return max(0.0, 1 - _WANDERED / max(_away(body), 1e-9))


def _not_backward(body, seconds=_BACK):
  """Whether there is no walk backward; one that leads there and back again is one event, which would not tell."""
  ahead = np.stack([np.sin(body.heading), np.cos(body.heading)], -1)
  along = (np.gradient(body.path, axis=0) * ahead).sum(-1) * body.fps
  back = (along < -_PACE) & (-along > _STRAIGHT * body.speed)
  return back.sum() < seconds * body.fps


def _no_step_back(body):
  return _not_backward(body, _STEP_BACK)


def _usual(body):
  """How high the pelvis is of a body that stands: as high as most of the time, or, where it hardly ever stands, as its
  legs are long."""
  joints = body.joints
  thighs, shins = joints[:, [1, 2]] - joints[:, [4, 5]], joints[:, [4, 5]] - joints[:, [7, 8]]
  leg = float(np.linalg.norm(thighs, axis=-1).mean() + np.linalg.norm(shins, axis=-1).mean())
  return max(np.percentile(joints[:, 0, 1], 90), _STANDS * leg)


def _stirs(body):
  """How much of the time a hand, a foot or the head moves, and more where they end elsewhere; 0 of one that but sways.
  """
  ends = body.joints[:, [10, 11, 15, 20, 21]]
  speed = np.linalg.norm(np.diff(ends, axis=0), axis=-1).max(1) * body.fps
  moves, away = float((speed > _SWAY).mean()) if len(speed) else 0.0, _away(body)
  return min((moves if moves > 0.1 else 0.0) + (away if away > 0.15 else 0.0), 1.0)


def _is_low(body):
  return body.joints[:, 0, 1] < _LOW * _usual(body)


def _sits(body):
  thighs = body.local("knee", "hip")
  return _is_low(body) & (-thighs[..., 1] < np.cos(np.radians(_THIGHS)) * np.linalg.norm(thighs, axis=-1)).all(1)


def _last(body):
  return slice(-max(round(_WHILE * body.fps), 1), None)


def _not_down(body):
  return _sits(body).sum() < _WHILE * body.fps


def _not_seated(body):
  return 0.5 * (not _sits(body)[_last(body)].all())


def _not_up(body):
  return not (_is_low(body).any() and body.joints[_last(body), 0, 1].min() > _UP * _usual(body))


def _foot_heights(body):
  """Height (T,) of the lowest joint of the feet, smooth, the most of it at its beginning and the mean at its end."""
  height = body.smooth(body.joints[:, [7, 8, 10, 11], 1].min(1), 0.2)
  few = max(round(_WHILE * body.fps), 1)
  return height, float(height[:few].max()), float(height[-few:].mean())


def _not_climbed(body):
  """How far a body is from going up by a step or two, and how far below its beginning it gets."""
  height, start, _ = _foot_heights(body)
  below = start - float(height.min())
  return _short_of(float(height.max()) - start) + (min(below, 2.0) if below > _STEP_UP / 2 else 0.0)


def _not_descended(body):
  _, start, end = _foot_heights(body)
  return _short_of(start - end)


def _short_of(metres):
  return float(np.clip(1 - metres / _STEP_UP, 0.0, 0.9))


# How much is missed of what is no kind of event.
_MISSED = {"dance": _wanders, "run": _too_fast, "still": _stirs, "rise": _not_up, "seated": _not_seated,
           "sit": _not_down, "step": _no_step_back, "walk": _not_backward, "ascend": _not_climbed,
           "descend": _not_descended}
