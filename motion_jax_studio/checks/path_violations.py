"""Prompt checks of paths: how far a body's path is from the shape or pace that its prompt requires.

Circles, half circles, figures of eight, curves and zigzags are measured by the direction of travel, slow and quick by
the usual pace of captions by kinematics (`analysis.event_words`).
"""
import numpy as np

from motion_jax.analysis.event_words import QUICKLY, SLOWLY, USUAL
from motion_jax.analysis.signals import Body, course_of, turning_points
from motion_jax_studio.language.path_shapes import PACES, PathShape

_MOVING, _MOVING_SLOWLY = 0.3, 0.12  # least metres per second of a moving body, and of one that has to be slow
_CIRCLE = 300.0     # degrees of a circle at least, as in `analysis.events`
_LOOP = 270.0       # degrees of each loop of a figure of eight at least: those of a lemniscate
_HALF_CIRCLE, _CURVE = (150.0, 210.0), (40.0, 300.0)
_ZIGZAG_TURNS, _ZIGZAG_ANGLE = 4, 25.0  # turns of a zigzag, and degrees of each at least
_STRAIGHT = 45.0    # degrees by which a straight path bends at most
_TURNED_BACK = 30.0  # degrees by which a circle may turn the other way
_WORST = 0.9        # largest violation of a path with another shape; 1 is for a body that stays in place


def path_violation(body: Body, shape: PathShape) -> float:
  """How far a body's path is from a shape or pace; 0 if it is met.

  Up to 0.9 by the error in degrees or speed; 1 for a turn to the other side, and for a body that stays in place.
  """
  if body.num < 4:
    return float(shape.kind != "usual")
  going = body.speed > (_MOVING_SLOWLY if shape.kind == "slowly" else _MOVING)
  if going.sum() < max(0.5 * body.fps, 4):
    return float(shape.kind != "usual")
  if shape.kind in PACES:
    return _off_pace(float(np.median(body.speed[going])), *shape)
  course = course_of(body.smooth(body.path, 0.3)[going])
  total, spread = course[-1] - course[0], float(np.ptp(course))
  if shape.kind == "straight":
    return _share(spread - _STRAIGHT, 180)
  if shape.kind == "zigzag":
    return _share(_ZIGZAG_TURNS + 1 - len(turning_points(course, _ZIGZAG_ANGLE)), _ZIGZAG_TURNS)
  if shape.kind == "figure-eight":
    turned = np.abs(course - course[0])
    most = int(turned.argmax())
    return _share(_LOOP - min(turned[most], abs(course[-1] - course[most])), _LOOP)
  if shape.side and abs(total) > _ZIGZAG_ANGLE and (total > 0) != (shape.side == "left"):
    return 1.0
  least, most = {"circle": (_CIRCLE, np.inf), "u-turn": _HALF_CIRCLE, "curve": _CURVE}[shape.kind]
  back = max(spread - abs(total) - _TURNED_BACK, 0.0)
  return _share(max(least - abs(total), abs(total) - most, 0.0) + back, least)


def _off_pace(pace, kind, gait):
  """Pace: below 0.75 of the usual one for "slowly", above 1.3 for "quickly", below 1.3 for "usual"."""
  ratio = pace / USUAL[f"{gait} forward"]
  return _share({"slowly": ratio - SLOWLY, "quickly": QUICKLY - ratio, "usual": ratio - QUICKLY}[kind], 1.0)


def _share(by, of):
  """A deviation as a violation: by / of, between 0 and `_WORST`."""
  return float(np.clip(by / of, 0.0, _WORST))
