"""The shape and pace of a path, as a sentence describes them: `checks.path_shapes` measures how far joints are from it.
"""
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from motion_studio.language.actions import RUNS

if TYPE_CHECKING:
  from motion_studio.language.plan import Action

_WALKS = set("walk stroll stride march wander saunter amble pace hurry rush circle zigzag".split())
_LIGHT = {"make", "do", "take", "perform"}  # "makes a u-turn while walking"
# What leaves no way of its own behind: these beside a walk leave it the only way of a sentence.
_STAYS = set("sit stand stop rest wait stay pause halt squat crouch kneel lie kick jump bow lean".split())
_TURNS = {"turn", "spin", "rotate", "pivot"}
_BARE = {"forward", "forwards", "ahead", "back", "away", "on"}
_SPELT = ((r"\b(counter|anti)[- ]?clock-?wise\b", "counterclockwise"), (r"\bzig[- ]zag", "zigzag"),
          (r"\bsemi[- ]?circle|\bhalf(?: of)? an? circle|\bhalf-circle", "half circle"), (r"\bu turn", "u-turn"))
_BESIDE = re.compile(r",| (?:with|while|starting|leading|dragging|leaning|kicking|waving|looking)\b")  # not of the way
_LIMBS = re.compile(r"\b(?:arms?|hands?|legs?|knees?|head|hips?|fingers?|foot|feet|toes?|shoulders?|wrists?|ankles?|"
                    r"elbows?|torso|waist|chest|neck|air)\b")
_NONE = re.compile(r"\b(?:then|in place|on the spot)\b")  # several ways in one, or no way at all
_SIZE = r"(?:(?:full|whole|complete|big|small|large|wide|tight|little|single|clockwise|counterclockwise|few) )*"
_SHAPES = {shape: re.compile(words) for shape, words in {  # the first that is found is meant
    "": r"\bquarters?\b|\d ?/ ?\d|\bhalf ?-?way\b|\barc\b|\bdegrees?\b|\band a half\b|\bcircle of\b",
    "u-turn": r"\bu-turn|\bhalf circle",
    "zigzag": r"\bzigzag",
    "circle": rf"\bin (?:an? |one |two |three )?{_SIZE}circles?\b|\bcircular\b|\b\w+s (?:around )?(?:an? |one |two "
              rf"|three )?{_SIZE}circles?\b|\boval\b|clockwise\b|\bcircles (?:around|to)\b",
    "straight": r"\bstraight(?: ahead| on| forwards?| line)?$|\bstraight (?:ahead|on|forwards?|line)\b"}.items()}
_A_CIRCLE = re.compile(r"\bcircles?\b(?! of| around| to)", re.IGNORECASE)
_BENDS = re.compile(r"\b(?:veer|turn|curv|swerv|back\b|forth\b)")
_SIDES = {"left": re.compile(r"\b(?:left|counterclockwise)\b"), "right": re.compile(r"\b(?:right|clockwise)\b")}
_PACES = {"slowly": re.compile(r"\b(?:slow|slowly|leisurely)\b"),
          "quickly": re.compile(r"\b(?:fast|quick|quickly|briskly|brisk|rapidly|swiftly)\b")}
_AT_EASE = {"walk", "stroll", "saunter", "wander", "amble"}  # no faster than usual where no pace is said
_HURRIES = {"hurry", "rush", "sprint", "dash"}
# Words of a walk whose usual pace is another one, or that does not keep it.
_OTHERWISE = re.compile(r"\b(?:back|backwards?|sideways|diagonal(?:ly)?|normal)\b")
_CHANGES = re.compile(r"\b(?:first|faster|slower|speed\w*|slows|slowing|gradually|stops?)\b")
# Seconds of a circle, as long as `cmdm-small`'s; by clips of arcs `cmdm-open` would take 3 to 4. Of its 20 circles none
# is gone round in these, 9 are in 6, 16 in 7.5, all in 9.
_WALK_ROUND, _RUN_ROUND = 8.0, 6.5


class PathShape(NamedTuple):
  """What a sentence says of a walk: its shape (circle, u-turn, zigzag, straight) to a side or to either (""), or its
  pace (slowly, quickly, usual), of which side says who is meant: walk or run."""
  kind: str
  side: str


PACES = frozenset([*_PACES, "usual"])
KINDS = (PACES | frozenset(_SHAPES)) - {""}
BENT = frozenset({"circle", "u-turn", "zigzag"})  # what the course of a turn is part of


def is_gait(verb: str) -> bool:
  """Whether a verb says that somebody walks or runs."""
  return verb in _WALKS or verb in RUNS


def ways_of(verb: str, words: str) -> list[PathShape]:
  """What the words of an action, without its subject, say of where it leads and how fast; nothing of other actions, of
  walks in place, or of two ways in one."""
  words = words.lower()
  for spelt, usual in _SPELT:
    words = re.sub(spelt, usual, words)
  gait = "walk" if verb in _WALKS else "run" if verb in RUNS else ""
  own = _BESIDE.split(words, maxsplit=1)[0]
  if _NONE.search(words) or _LIMBS.search(own if gait else words) or not gait and verb not in _LIGHT:
    return []
  shape = next((shape for shape, said in _SHAPES.items() if said.search(own)), "")
  found = [PathShape(shape, _side_of(own, words))] if shape in ("circle", "u-turn") else []
  if shape == "zigzag" or shape == "straight" and not _BENDS.search(words):
    found = [PathShape(shape, "")]
  if not gait:
    return [way for way in found if way.kind == "u-turn"]
  paces = [pace for pace, said in _PACES.items() if said.search(own)] or ["quickly"] * (verb in _HURRIES)
  if _OTHERWISE.search(own) or _CHANGES.search(words) or len(paces) > 1:
    return found
  return found + [PathShape(pace, gait) for pace in paces or (["usual"] if verb in _AT_EASE else [])]


def _side_of(own, words):
  turning = re.search(r"\bturning(?: to the)? (left|right)\b", words)
  sides = [side for side, said in _SIDES.items() if said.search(own)] or ([turning[1]] if turning else [])
  return sides[0] if len(sides) == 1 else ""


def path_shapes_of(actions: "Sequence[Action]") -> list[PathShape]:
  """The way that all of a sentence's actions have together: that of the only one that leads anywhere, or the u-turn
  that somebody makes who walks and does no more; of several that lead somewhere each has a way of its own. Beside a
  walk whoever turns changes where it leads, but not its pace."""
  found = [(action, ways_of(action.verb, action.words)) for action in actions
           if action.part in ("legs", "body", "") and action.verb not in _STAYS]
  made = [ways for action, ways in found if action.verb in _LIGHT and ways]
  going = [(action, ways) for action, ways in found if action.verb not in _LIGHT | _TURNS]
  if made:
    bare = all(_BARE.issuperset(action.words.lower().split()[1:]) for action, _ in going)
    return made[0] if len(made) == 1 and bare else []
  if len(going) != 1:
    return []
  turns = any(action.verb in _TURNS for action, _ in found)
  return [way for way in going[0][1] if way.kind in PACES or not turns]


def min_duration(actions: "Sequence[Action]", text: str) -> float:
  """Seconds that a circle takes at least, walking or running; 0 for other paths."""
  circle = "circ" in text.lower() and any(shape.kind == "circle" for shape in path_shapes_of(actions))
  return 0.0 if not circle else _RUN_ROUND if any(action.verb in RUNS for action in actions) else _WALK_ROUND


def with_a_side(text: str, number: int) -> str:
  """The sentence with a side behind its circle, "in a circle to the left", or right for an even number; as it is where
  it has no single circle."""
  side = "left" if number % 2 else "right"
  found = _A_CIRCLE.findall(text)
  return text if len(found) != 1 else _A_CIRCLE.sub(rf"\g<0> to the {side}", text)
