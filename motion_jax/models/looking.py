"""Does a motion show what its sentence asks for? What can be seen on the joints is looked for; see `composed.generate`.

`motion.events` sees kicks, punches, jumps, hops, squats, bows, waving hands, turns and walks backward, of which side
they are, and how many. Its rules are in doubt now and then, so a motion in which something is not seen may still be a
good one.
"""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Num

from motion_jax.motion.events import find_events
from motion_jax.text.sentences import actions_of

_KINDS = {"kick": "kick", "punch": "punch", "jab": "punch", "box": "punch", "shadowbox": "punch", "jump": "jump",
          "hop": "hop", "squat": "squat", "bow": "bow", "wave": "wave", "turn": "turn"}  # verb: kind of event
_SIDED = {"kick", "punch", "wave", "turn"}
_COUNTED = {"kick", "punch", "jump", "hop", "squat", "bow"}  # whose number means how often they are done
_BACKWARD = {"backward", "backwards"}
_WITHOUT = {"without", "not", "no", "never", "nor", "don't", "doesn't"}


class Asked(NamedTuple):
  """Something that is to be seen: a kind of event, of the left or right or of either (""), backward for walks, and how
  often: times, or, not counted, as often or more."""
  kind: str
  side: str
  times: int
  counted: bool


def asked_of(text: str) -> list[Asked]:
  """What a sentence asks for that can be seen; nothing of one that says what is not done."""
  if _WITHOUT & set(text.lower().split()):
    return []
  found: dict[tuple[str, str], Asked] = {}
  for action in actions_of(text):
    words, kind, side = set(action.words.lower().replace(",", " ").split()), _KINDS.get(action.verb), ""
    if action.verb == "walk" and words & _BACKWARD:
      kind, side = "walk", "backward"
    if kind is None or action.held:
      continue
    named = {"left", "right"} & words
    if kind in _SIDED and len(named) == 1:
      side = named.pop()
    before = found.get((kind, side), Asked(kind, side, 0, False))
    counted = before.counted or action.times > 1 and kind in _COUNTED
    found[kind, side] = Asked(kind, side, before.times + (action.times if kind in _COUNTED else 1), counted)
  return list(found.values())


def misses(joints: Num[np.ndarray, "t 22 3"], asked: Sequence[Asked], fps: float = 20.0) -> int:
  """How much of what is asked is not to be seen in joints (T, 22, 3), and how much too often where that is counted."""
  if not asked:
    return 0
  events, missed = find_events(joints, fps), 0
  for kind, side, times, counted in asked:
    own = [event for event in events if event.kind == kind and side in ("", event.side, event.way)
           or event.kind == kind and event.side == "both"]
    number = sum(max(event.count, 1) if kind in _COUNTED else 1 for event in own)
    missed += abs(number - times) if counted else max(times - number, 0)
  return missed
