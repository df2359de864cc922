"""Prompt checks of postures and places: bending, crouching, lifting a foot, standing on one leg; staying in place,
going to a side, coming back.

Each function takes a `Body` and, if its requirement has a side, the requirement; it returns 0 if that is met, else up
to 1.
"""
import numpy as np

from motion_jax.analysis.signals import PAIR, SIDES, Body
from motion_jax_studio.language.requirements import Requirement

_BENT = 32.0           # least degrees of a bent trunk
_HEIGHT_PER_LEG = 1.1  # height of the standing pelvis in lengths of a leg, at least; median of CMU 1.14, of Bandai 1.18
_CROUCHED = 0.78       # of the height of the standing pelvis
_CROUCH_SECONDS, _BALANCE_SECONDS = 0.6, 1.1
_LIFTED, _OFF_GROUND = 0.17, 0.13  # least metres of a lifted foot over the other one, and over the ground
_TREADS = 0.07         # least metres of each foot over the other one in a walk in place
_STAYS, _AWAY = 0.6, 0.8  # metres from the start: most of a body in place, least of one that goes away
_BACK = 0.4            # share of the furthest distance within which a body has come back
_ASIDE, _ASIDE_DEGREES = 0.6, (35.0, 145.0)  # metres of a way to a side, and degrees from where the body faced


def not_bent(body: Body) -> float:
  """Bend: the trunk leans by 32 degrees or more."""
  return _lacks(float(body.trunk.max()), _BENT)


def upright_height(body: Body) -> float:
  """Height of the standing pelvis over the soles, estimated from the length of the legs."""
  joints = body.joints
  thighs, shins = joints[:, [1, 2]] - joints[:, [4, 5]], joints[:, [4, 5]] - joints[:, [7, 8]]
  return _HEIGHT_PER_LEG * float(np.linalg.norm(thighs, axis=-1).mean() + np.linalg.norm(shins, axis=-1).mean())


def not_crouched(body: Body) -> float:
  """Crouch: the pelvis is below 0.78 of its standing height (seen, or by the legs) for 0.6 s."""
  height = body.pelvis / max(float(np.percentile(body.pelvis, 95)), upright_height(body), 1e-6)
  if body.spans(height < _CROUCHED, least=_CROUCH_SECONDS):
    return 0.0
  return max(_lacks(1 - float(height.min()), 1 - _CROUCHED), 0.1)


def foot_not_lifted(body: Body, requirement: Requirement) -> float:
  """Lift a foot or knee: the foot is 0.17 m over the other one."""
  height = body.joints[:, PAIR["foot"], 1]
  over = {side: float((height[:, foot] - height[:, 1 - foot]).max()) for foot, side in enumerate(SIDES)}
  return _lacks(over.get(requirement.side, max(over.values())), _LIFTED)


def not_balanced(body: Body, requirement: Requirement) -> float:
  """Stand on one leg, the named one or any: the other foot is off the ground for 1.1 s while this one stands."""
  up = body.joints[:, PAIR["foot"], 1] - body.floor > _OFF_GROUND
  stands = [SIDES.index(requirement.side)] if requirement.side else [0, 1]
  spans = [past - first for foot in stands for first, past in body.spans(up[:, 1 - foot] & ~up[:, foot])]
  return _lacks(max(spans, default=0) / body.fps, _BALANCE_SECONDS)


def does_not_tread(body: Body) -> float:
  """Walk or run in place: each foot is lifted twice or more."""
  height = body.joints[:, PAIR["foot"], 1]
  lifts = [len(body.spans(height[:, foot] - height[:, 1 - foot] > _TREADS, least=0.05)) for foot in (0, 1)]
  return _lacks(min(lifts), 2)


def leaves_its_place(body: Body) -> float:
  """Stay in place: never more than 0.6 m from where it began."""
  away = float(np.linalg.norm(body.path - body.path[:1], axis=-1).max())
  return float(np.clip(away / _STAYS - 1, 0.0, 0.9))


def not_come_back(body: Body) -> float:
  """Come back: 0.8 m away or more, and at the end within 0.4 of the furthest distance."""
  away = np.linalg.norm(body.path - body.path[:1], axis=-1)
  furthest = float(away.max())
  return max(_lacks(furthest, _AWAY), float(np.clip(away[-1] / max(furthest, 1e-6) - _BACK, 0.0, 0.9)))


def not_aside(body: Body, requirement: Requirement) -> float:
  """Go to a side: 0.6 m or more, 35 to 145 degrees to that side of where the body faced."""
  way = body.path[-1] - body.path[0]
  angle = np.arctan2(way[0], way[1]) - body.heading[:max(body.num // 10, 1)].mean()
  degrees = np.degrees(np.angle(np.exp(1j * angle))) * (1 if requirement.side == "left" else -1)
  low, high = _ASIDE_DEGREES
  off = float(np.clip(max(low - degrees, degrees - high) / 90, 0.0, 0.9))
  return max(off, _lacks(float(np.linalg.norm(way)), _ASIDE / 2))


def other_hand_acts(body: Body, requirement: Requirement) -> float:
  """An action of one hand: that hand is no slower than the other, seen from its shoulder, in root mean square."""
  speed = np.sqrt((np.diff(body.local("wrist", "shoulder"), axis=0) ** 2).sum(-1).mean(0))
  hand = SIDES.index(requirement.side)
  return _lacks(float(speed[hand]), max(float(speed[1 - hand]), 1e-6))


def _lacks(value, least):
  """The share of the least value that is missing: 0 to 0.9."""
  return float(np.clip(1 - value / least, 0.0, 0.9))


MEASURES = {"bend": not_bent, "crouch": not_crouched, "treads": does_not_tread, "stays": leaves_its_place,
            "return": not_come_back}
SIDED_MEASURES = {"foot": foot_not_lifted, "balance": not_balanced, "aside": not_aside, "acts": other_hand_acts}
