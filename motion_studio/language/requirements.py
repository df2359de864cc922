"""What a sentence requires of a motion, as far as it can be measured on joints: `checks.requirements` measures it."""
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from motion_studio.language import path_shapes as ways
from motion_studio.language.actions import RUNS
from motion_studio.language.lexicon import HOLD
from motion_studio.language.light_verbs import LIGHT

if TYPE_CHECKING:
  from motion_studio.language.plan import Action

# Kinds of events by verb; of sitting, getting up, dances and walks backward there is none, they are measured here.
_KINDS = {"kick": "kick", "punch": "punch", "jab": "punch", "box": "punch", "shadowbox": "punch", "jump": "jump",
          "hop": "hop", "squat": "squat", "bow": "bow", "wave": "wave", "turn": "turn", "sit": "sit"}
_SIDED = {"kick", "punch", "wave", "turn"}
COUNTED = {"kick", "punch", "jump", "hop", "squat", "bow"}  # whose number means how often they are done
_BACKWARD = {"backward", "backwards"}
_TURNING = re.compile(r"\bturn(?:s|ing)(?: (?:around|back|sharply|gently|quickly|slowly))*(?: to (?:the|his|her))? "
                      r"(left|right)\b|\b(left|right) turn\b")
_BLOWS, _FISTS = {"strike", "hit"}, {"fist", "fists"}
_SOMEWHERE = {"across", "along", "around", "away", "backward", "backwards", "circle", "circles", "forward", "forwards",
              "into", "left", "out", "right", "round", "sideways", "through", "toward", "towards"}
_RISES = {("stand", "up"), ("get", "up"), ("rise", "")}  # verb, and the word that it needs
_STAIRS = {"stairs", "stair", "steps", "staircase", "stairway", "ladder", "hill", "slope", "ramp"}
_ACROSS = {"over", "through", "under", "into", "in", "out", "off", "on", "onto", "around"}  # no climb up or down
_UPRIGHT = {"straight", "tall", "upright"}
_WITHOUT = {"without", "not", "no", "never", "nor", "don't", "doesn't"}

# Degrees that a body turns by in all, by words of a turn that names none; one to a side of which no more is said is no
# turning round. A number that is named may be missed by _NEAR, or by a fifth of it.
_DEGREES = (({"full", "all", "fully", "completely"}, (290, 430)), ({"corner"}, (40, 140)),
            ({"around", "round", "about", "back"}, (130, 230)), ({"left", "right"}, (40, 140)))
_NEAR = 40


class Requirement(NamedTuple):
  """Something that a motion has to show: a kind of event, of the left or right or of either (""), backward for walks,
  or a `ways.Way`, of which side may be walk or run; how often: times, or, not counted, as often or more. degrees: least
  and most that a turn has in all."""
  kind: str
  side: str
  times: int
  counted: bool
  degrees: tuple[float, float] | None = None


def requirements_of(actions: "Sequence[Action]", text: str) -> list[Requirement]:
  """What actions require that can be measured; nothing where their text says what is not done."""
  found: dict[tuple[str, str], Requirement] = {}
  if len(actions) == 1 and _stands_still(actions[0]):  # also who "does not move"
    return [Requirement("still", "", 1, False)]
  if _WITHOUT & set(text.lower().split()):
    return []
  if actions and all(map(_dances_in_place, actions)):
    found["dance", ""] = Requirement("dance", "", 1, False)
  if _ends_seated(actions):
    found["seated", ""] = Requirement("seated", "", 1, False)
  if actions and _gets_up(actions[-1]):
    found["rise", ""] = Requirement("rise", "", 1, False)
  led = ways.path_shapes_of(actions)
  found |= {way: Requirement(*way, 1, False) for way in led}
  climbs = {_climbs(action) for action in actions} - {""}
  if len(climbs) == 1:  # of who climbs up and down again neither is measured
    kind = climbs.pop()
    found[kind, ""] = Requirement(kind, "", 1, False)
  for action in actions:
    words, kind, side = set(action.words.lower().replace(",", " ").split()), _KINDS.get(action.verb), ""
    if action.verb == "walk" and words & _BACKWARD:
      kind, side = "step" if action.counts_steps else "walk", "backward"
    if action.verb in _BLOWS and words & _FISTS:
      kind = "punch"
    turning = _TURNING.search(action.words.lower()) if kind is None and ways.is_gait(action.verb) else None
    if turning and not any(way.kind in ways.BENT for way in led):  # "walks, turning to the left"
      kind, side = "turn", turning[1] or turning[2]
    if action.verb in RUNS and not action.is_pose:
      found["run", ""] = Requirement("run", "", 1, False)
    if kind is None or action.is_pose or action.part == "head":  # "turns the head"
      continue
    named = {"left", "right"} & words
    if kind in _SIDED and not side and len(named) == 1:
      side = named.pop()
    before = found.get((kind, side), Requirement(kind, side, 0, False))
    counted = before.counted or action.times > 1 and kind in COUNTED
    several = before.times or action.times > 1
    degrees = _degrees_of(action.words.lower()) if kind == "turn" and not several else None
    times = before.times + (action.times if kind in COUNTED else 1)
    found[kind, side] = Requirement(kind, side, times, counted, degrees)
  return list(found.values())


def is_counted(requirements: Sequence[Requirement]) -> bool:
  """Whether nothing is required but one action that can be counted: a kick, a jump, a bow."""
  return len(requirements) == 1 and requirements[0].kind in COUNTED


def once(requirements: Sequence[Requirement]) -> list[Requirement]:
  """The same requirements, where what can be counted is done exactly once."""
  return [one._replace(counted=True) if one.kind in COUNTED and one.times == 1 else one for one in requirements]


def _degrees_of(words):
  number = re.search(r"(\d+)(?: ?°| degrees?)", words)
  if number:
    named = float(number[1])
    off = max(_NEAR, named / 5)
    return named - off, named + off
  return next((span for said, span in _DEGREES if said & set(words.split())), None)


def _ends_seated(actions):
  """Whether sitting down comes last, but for what is done on the chair: staying there, waving."""
  holds = [i for i, action in enumerate(actions) if action.words == HOLD]
  last = next((i for i in holds if all(one.words == HOLD or one.part in ("arms", "head") for one in actions[i:])),
              len(actions))
  return any(action.verb == "sit" for action in actions[last - 1:last])


def _dances_in_place(action):
  words = set(action.words.lower().split())
  does = action.verb == "dance" or action.verb in LIGHT and bool(words & {"dance", "dances"})
  return does and not words & _SOMEWHERE


def _climbs(action):
  """"ascend" or "descend" of stairs, a ladder and the like, "" of any other action."""
  words = set(action.words.lower().replace(",", " ").split()[1:])
  if words & _ACROSS or {"up", "down"} <= words:
    return ""
  if action.verb == "descend" or "down" in words and (action.verb == "climb" or words & _STAIRS and _goes(action)):
    return "descend"
  return "ascend" if action.verb == "climb" or "up" in words and words & _STAIRS and _goes(action) else ""


def _goes(action):
  return ways.is_gait(action.verb) or action.verb in ("step", "go", "come", "move")


def _stands_still(action):
  return action.verb in ("stand", "stay") and bool({"still", "place", "motionless"} & set(action.words.lower().split()))


def _gets_up(action):
  words = set(action.words.lower().split())
  return any(action.verb == verb and word in words | {""} for verb, word in _RISES) and not words & _UPRIGHT
