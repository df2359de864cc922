"""Where a walk leads, and how fast: what a sentence says of it, and how far the joints of a motion are from that.

Circles, half circles and zigzags are told by the course over the ground, slow and quick by the usual pace of captions
by kinematics (`data.event_words`). For `looking`, which has a motion made anew that does not show them.
"""
import numpy as np

from motion_jax.analysis.event_words import QUICKLY, SLOWLY, USUAL
from motion_jax.analysis.signals import Body, course_of, turning_points
from motion_studio.language import parse
from motion_studio.language.path_shapes import BENT, KINDS, PACES, PathShape, is_gait, with_a_side  # noqa: F401

_GOES, _CREEPS = 0.3, 0.12  # metres a second of whoever goes somewhere, and of whoever does so slowly
_ROUND = 300.0      # degrees of a circle at the least; as in `motion.events`
_HALF = (150.0, 210.0)
_SWERVES, _SWERVE = 4, 25.0  # how often, and by how many degrees at the least, a zigzag turns
_BENT = 45.0        # degrees by which the course of a straight way turns at the most
_BACK = 30.0        # degrees by which one that leads round one way may turn the other way
_MOST = 0.9         # of what is asked that is missed where it does not show well; less than where it is not there


def least_seconds(text: str) -> float:
  """Former way to `parse(text).min_duration`."""
  return parse(text).min_duration


Way = PathShape  # its former name


def missed(body: Body, way: Way) -> float:
  """How much of a way is not to be seen in a body: 0 to 0.9 by how far it is from it, 1 of one to the other side or who
  goes nowhere."""
  if body.num < 4:
    return float(way.kind != "usual")
  going = body.speed > (_CREEPS if way.kind == "slowly" else _GOES)
  if going.sum() < max(0.5 * body.fps, 4):
    return float(way.kind != "usual")
  if way.kind in PACES:
    return _off_pace(float(np.median(body.speed[going])), *way)
  course = course_of(body.smooth(body.path, 0.3)[going])
  total, spread = course[-1] - course[0], float(np.ptp(course))
  if way.kind == "straight":
    return _share(spread - _BENT, 180)
  if way.kind == "zigzag":
    return _share(_SWERVES + 1 - len(turning_points(course, _SWERVE)), _SWERVES)
  if way.side and abs(total) > _SWERVE and (total > 0) != (way.side == "left"):
    return 1.0
  least, most = (_ROUND, np.inf) if way.kind == "circle" else _HALF
  back = max(spread - abs(total) - _BACK, 0.0)
  return _share(max(least - abs(total), abs(total) - most, 0.0) + back, least)


def _off_pace(pace, kind, gait):
  ratio = pace / USUAL[f"{gait} forward"]
  return _share({"slowly": ratio - SLOWLY, "quickly": QUICKLY - ratio, "usual": ratio - QUICKLY}[kind], 1.0)


def _share(by, of):
  return float(np.clip(by / of, 0.0, _MOST))
