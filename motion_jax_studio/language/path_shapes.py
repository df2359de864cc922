"""The shape and pace of a path, as a sentence describes them: `checks.path_violations` measures it on joints."""
import re
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.meaning import is_a, kind_of, pace_of
from motion_jax_studio.language.segments import Action

# Where words about the path end.
_BESIDE = re.compile(r",(?! (?:counter)?clockwise)| (?:with|while|starting|leading|dragging|leaning|kicking|waving|"
                     r"looking)\b")
_NONE = re.compile(r"\b(?:then|in place|on the spot)\b")  # several paths in one, or no path
_SIZE = r"(?:(?:full|whole|complete|big|small|large|wide|tight|little|single|clockwise|counterclockwise|few) )*"
_SHAPES = {shape: re.compile(words) for shape, words in {  # the first that matches; "" is no shape
    "": r"\bquarters?\b|\d ?/ ?\d|\bhalf ?-?way\b|\bdegrees?\b|\band a half\b|\bcircle of\b|clockwise from\b",
    "u-turn": r"\bu-turn|\bhalf circle",
    "zigzag": r"\bzigzag",
    "figure-eight": r"\bfigure-eight",
    "curve": r"\bcurve[ds]?\b|\bcurving\b|\barc\b",
    "circle": rf"\bin (?:an? |one |two |three )?{_SIZE}circles?\b|\bcircular\b|\b\w+s (?:around )?(?:an? |one |two "
              rf"|three )?{_SIZE}circles?\b|\boval\b|clockwise\b|\bcircles (?:around|to)\b",
    "straight": r"\bstraight(?: ahead| on| forwards?| line)?$|\bstraight (?:ahead|on|forwards?|line)\b"}.items()}
_WORD = re.compile(r"\w+")
_LIMBS = lexicon.LIMBS | {"air"}
_TURNS = ("turn", "spin")
_A_CIRCLE = re.compile(r"\bcircles?\b(?! of| around| to)", re.IGNORECASE)
_BENDS = re.compile(r"\b(?:veer|turn|curv|swerv|back\b|forth\b)")
_SIDES = {"left": re.compile(r"\b(?:left|counterclockwise)\b"), "right": re.compile(r"\b(?:right|clockwise)\b")}
# Words of a walk whose usual pace is another one, or that changes its pace.
_OTHERWISE = re.compile(r"\b(?:back|backwards?|sideways|diagonal(?:ly)?|normal)\b")
_CHANGES = re.compile(r"\b(?:first|faster|slower|speed\w*|slows|slowing|gradually|stops?)\b")
# Seconds of a full circle, as in `cmdm-small`. `cmdm-open` would take 3 to 4 by its clips, which are arcs: of its 20
# circles none is complete in these, 9 are in 6 s, 16 in 7.5 s, all in 9 s.
_CIRCLE_SECONDS = {"walk": 8.0, "run": 6.5}
_CIRCLES = {"circle": 1.0, "figure-eight": 1.5}  # as long as circles: those of a figure of eight are smaller


class PathShape(NamedTuple):
  """The shape of a path, or its pace."""
  kind: str  # "circle", "u-turn", "curve", "zigzag", "figure-eight", "straight"; "slowly", "quickly", "usual"
  side: str  # of a shape "left", "right" or "" for any; of a pace its gait, "walk" or "run"


PACES = frozenset({"slowly", "quickly", "usual"})
KINDS = (PACES | frozenset(_SHAPES)) - {""}
BENT = frozenset({"circle", "u-turn", "zigzag", "figure-eight", "curve"})  # they contain turns


def is_gait(verb: str) -> bool:
  """Whether a verb is a kind of walking or running."""
  return is_a(verb, "walk", "run")


def _shapes_of(verb, words):
  """Shape and pace of the path of one action; none of other actions, of walks in place and of two paths in one."""
  words = words.lower()
  kind = kind_of(verb, "walk", "run")
  gait, manner = (kind.verb, kind.manner) if kind else ("", ())
  own = _BESIDE.split(words, maxsplit=1)[0]
  if _NONE.search(words) or not (gait or verb in lexicon.LIGHT_VERBS) or not (
      _LIMBS.isdisjoint(_WORD.findall(own if gait else words))):
    return []
  shape = next((shape for shape, said in _SHAPES.items() if said.search(own)), "")
  found = [PathShape(shape, _side_of(own, words))] if shape in ("circle", "u-turn", "curve") else []
  if shape in ("zigzag", "figure-eight") or shape == "straight" and not _BENDS.search(words):
    found = [PathShape(shape, "")]
  if not gait:
    return [shape for shape in found if shape.kind == "u-turn"]
  paces = [*dict.fromkeys(pace for word in own.split() if (pace := pace_of(word)))]
  if not paces:
    paces = ["quickly"] if "quickly" in manner else ["usual"] if gait == "walk" and set(manner) <= {"slowly"} else []
  if _OTHERWISE.search(own) or _CHANGES.search(words) or len(paces) > 1:
    return found
  return found + [PathShape(pace, gait) for pace in paces]


def _side_of(own, words):
  turning = re.search(r"\bturning(?: to the)? (left|right)\b", words)
  sides = [side for side, said in _SIDES.items() if said.search(own)] or ([turning[1]] if turning else [])
  return sides[0] if len(sides) == 1 else ""


def path_shapes_of(actions: "Sequence[Action]") -> list[PathShape]:
  """Shape and pace of the path of actions, where only one of them goes anywhere; several have no common path.

  A turn beside a walk changes its shape, but not its pace; "makes a u-turn" gives its shape to a walk without one.
  """
  found = [(action, _shapes_of(action.verb, action.words)) for action in actions
           if action.part in ("legs", "body", "") and action.verb not in lexicon.STAYING_VERBS]
  made = [shapes for action, shapes in found if action.verb in lexicon.LIGHT_VERBS and shapes]
  going = [(action, shapes) for action, shapes in found
           if action.verb not in lexicon.LIGHT_VERBS and not is_a(action.verb, *_TURNS)]
  if made:
    is_free = all(lexicon.NO_DIRECTION.issuperset(action.words.lower().split()[1:]) for action, _ in going)
    return made[0] if len(made) == 1 and is_free else []
  if len(going) != 1:
    return []
  turns = any(is_a(action.verb, *_TURNS) for action, _ in found)
  return [shape for shape in going[0][1] if shape.kind in PACES or not turns]


def min_duration(actions: "Sequence[Action]") -> float:
  """Seconds that a circle or a figure of eight takes at least, walking or running; 0 for other paths."""
  circles = max((_CIRCLES.get(shape.kind, 0.0) for shape in path_shapes_of(actions)), default=0.0)
  return circles * _CIRCLE_SECONDS["run" if any(is_a(action.verb, "run") for action in actions) else "walk"]


def without_shape(text: str) -> str:
  """A text without what it says of a figure of eight, to which any walk is bent: "walks" of "walks in a figure 8"."""
  return re.sub(r"(?: in| along| on)? a figure-eight\b", "", lexicon.spelt(text), flags=re.IGNORECASE)


def with_explicit_side(text: str, number: int) -> str:
  """The text with a side after its circle: "in a circle to the left" for odd numbers, right for even ones.

  A text with no circle, or with several, stays as it is.
  """
  side = "left" if number % 2 else "right"
  found = _A_CIRCLE.findall(text)
  return text if len(found) != 1 else _A_CIRCLE.sub(rf"\g<0> to the {side}", text)
