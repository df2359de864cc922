"""Where a walk leads, and how fast: what a sentence says of it, and how far the joints of a motion are from that.

Circles, half circles and zigzags are told by the course over the ground, slow and quick by the usual pace of captions
by kinematics (`data.event_words`). For `looking`, which has a motion made anew that does not show them.
"""
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.data.event_words import QUICKLY, SLOWLY, USUAL
from motion_jax.motion.signals import Body, course_of, turning_points
from motion_jax.text.sentences import Action

_WALKS = set("walk stroll stride march wander saunter amble pace hurry rush circle zigzag".split())
_RUNS = set("run jog sprint dash".split())
_LIGHT = {"make", "do", "take", "perform"}  # "makes a u-turn while walking"
LEADS = _WALKS | _RUNS | {"turn", "spin", "step", "move", "go", "jump", "hop", "dance", "crawl", "sneak"}
_AHEAD = {"forward", "forwards", "ahead"}
_LIMBS = re.compile(r"\b(arms?|hands?|legs?|knees?|head|hips?|fingers?|air)\b")
_OTHERWISE = re.compile(r"\b(back|backwards?|sideways|diagonal(ly)?|normal|and (faster|slower))\b")
_SHAPES = {shape: re.compile(rf"\b({words})\b") for shape, words in {  # the first that is found is meant
    "u-turn": r"u[- ]turns?|half[- ]circles?|half (?:of )?a circle|semi-?circles?", "": r"quarters?",
    "zigzag": r"zig-?zag(?:s|ging)?", "circle": r"circles?|oval|counter-?clockwise|clockwise",
    "straight": r"straight (?:ahead|on|forwards?|line)"}.items()}
_SIDES = {"left": re.compile(r"\b(left|counter-?clockwise|anti-?clockwise)\b"),
          "right": re.compile(r"\b(right|(?<!-)clockwise)\b")}
_PACES = {"slowly": re.compile(r"\b(slow|slowly)\b"), "quickly": re.compile(r"\b(fast|quick|quickly|briskly|brisk)\b")}
_HURRIES = {"hurry", "rush", "sprint", "dash"}
_GOES = 0.3         # metres a second of whoever goes somewhere
_ROUND = 300.0      # degrees of a circle at the least; as in `motion.events`
_HALF = (150.0, 210.0)
_SWERVES, _SWERVE = 4, 25.0  # how often, and by how many degrees at the least, a zigzag turns
_BENT = 45.0        # degrees by which the course of a straight way turns at the most
_BACK = 30.0        # degrees by which one that leads round one way may turn the other way
_MOST = 0.9         # of what is asked that is missed where it does not show well; less than where it is not there


class Way(NamedTuple):
  """What a sentence says of a walk: its shape (circle, u-turn, zigzag, straight) to a side or to either (""), or its
  pace (slowly, quickly), of which side says who is meant: walk or run."""
  kind: str
  side: str


KINDS = frozenset([*_SHAPES, *_PACES]) - {""}


def ways_of(verb: str, words: str) -> list[Way]:
  """What the words of an action, without its subject, say of where it leads and how fast; nothing of other actions."""
  words = words.lower()
  gait = "walk" if verb in _WALKS else "run" if verb in _RUNS else ""
  if _LIMBS.search(words) or not gait and not (verb in _LIGHT and _SHAPES["u-turn"].search(words)):
    return []
  found, shape = [], next((shape for shape, said in _SHAPES.items() if said.search(words)), "")
  sides = [side for side, said in _SIDES.items() if said.search(words)] if shape in ("circle", "u-turn") else []
  if shape:
    found.append(Way(shape, sides[0] if len(sides) == 1 else ""))
  paces = [pace for pace, said in _PACES.items() if said.search(words)] or ["quickly"] * (verb in _HURRIES)
  if gait and len(paces) == 1 and not _OTHERWISE.search(words):
    found.append(Way(paces[0], gait))
  return found


def way_of_all(actions: Sequence[Action]) -> list[Way]:
  """The way that all of a sentence's actions have together: that of the only one that leads anywhere, or the u-turn
  that somebody makes who walks and does no more; of several that lead somewhere each has a way of its own."""
  found = [(action, ways_of(action.verb, action.words)) for action in actions]
  turned = [ways for action, ways in found if action.verb in _LIGHT and ways]
  led = [(action, ways) for action, ways in found if action.verb in LEADS]
  if not turned and len(led) == 1:
    return led[0][1]
  bare = all(_AHEAD.issuperset(action.words.lower().split()[1:]) for action, _ in led)
  return turned[0] if len(turned) == 1 and bare else []


def missed(body: Body, way: Way) -> float:
  """How much of a way is not to be seen in a body: 0 to 0.9 by how far it is from it, 1 of one to the other side or who
  goes nowhere."""
  going = body.speed > _GOES
  if going.sum() < max(0.5 * body.fps, 4):
    return 1.0
  if way.kind in _PACES:
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
  usual = USUAL[f"{gait} forward"]
  return _share(pace / usual - SLOWLY if kind == "slowly" else QUICKLY - pace / usual, 1.0)


def _share(by, of):
  return float(np.clip(by / of, 0.0, _MOST))
