"""The shape and pace of a path, as a sentence describes them: `checks.path_violations` measures it on joints."""
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.meaning import is_a, kind_of, pace_of
from motion_jax_studio.language.words import has_phrase, lookup, normalize, until

_ENDS = set(", with while starting leading dragging leaning kicking waving looking".split())  # end the path's words
_SIZES = set("full whole complete big small large wide tight little single few one two three".split())
_SHAPES = (  # the first that is said; "" is no shape
    ("", "quarter, quarters, half way, half-way, halfway, degree, degrees, and half, circle of, clockwise from, "
         "counterclockwise from"),
    ("u-turn", "u-turn*, half circle*"),
    ("zigzag", "zigzag*"),
    ("figure-eight", "figure-eight*"),
    ("curve", "curve, curved, curves, curving, arc"),
    ("circle", "in circle, in circles, around circle, around circles, circular, oval, clockwise, counterclockwise, "
              "circles around, circles to"),
    ("straight", "straight ahead, straight on, straight forward, straight forwards, straight line, straight ."))
_SIDES = (("left", "left, counterclockwise"), ("right", "right, clockwise"))
_TURNING = (("left", "turning left, turning to left"), ("right", "turning right, turning to right"))
_TURNS = ("turn", "spin")
_A_CIRCLE = r"(?i)\bcircles?\b(?! of| around| to)"
_NO_COURSE = "sideways, circle, circles, turn*, u-turn, arc, curv*, diagonal*, zigzag, from"  # paths without one side
_SIDED = {"foot", "leg", "hand", "arm"}
# Walks with another usual pace than walking forward, and walks that change their pace.
_OTHERWISE = "back, backward, backwards, sideways, diagonal, diagonally, normal"
_CHANGES = "first, faster, slower, speed*, slows, slowing, gradually, stop, stops"
# Seconds of a full circle, as in `cmdm-small`. Clips of `cmdm-open` take 3 to 4 s but are arcs: of 20 circles that it
# samples, none is complete in that time, 9 are in 6 s, 16 in 7.5 s, all in 9 s.
_CIRCLE_SECONDS = {"walk": 8.0, "run": 6.5}
_CIRCLES = {"circle": 1.0, "figure-eight": 1.5}  # duration in circles; the two loops of a figure of eight are smaller


class PathShape(NamedTuple):
  """The shape of a path, or its pace."""
  kind: str  # "circle", "u-turn", "curve", "zigzag", "figure-eight", "straight"; "slowly", "quickly", "usual"
  side: str  # of a shape "left", "right" or "" for any; of a pace its gait, "walk" or "run"


PACES = frozenset({"slowly", "quickly", "usual"})
KINDS = (PACES | frozenset(shape for shape, _ in _SHAPES)) - {""}
BENT = frozenset({"circle", "u-turn", "zigzag", "figure-eight", "curve"})  # they contain turns


def is_gait(verb: str) -> bool:
  """Whether a verb is a kind of walking or running."""
  return is_a(verb, "walk", "run")


def shapes_of(verb: str, words: tuple[str, ...]) -> tuple[PathShape, ...]:
  """Shape and pace of the path of one action; () for actions without a path, walks in place and two paths in one."""
  kind = kind_of(verb, "walk", "run")
  gait, manner = (kind.verb, kind.manner) if kind else ("", ())
  words = tuple(word for word, then in zip(words, (*words[1:], "")) if word != "," or not then.endswith("clockwise"))
  whole, words = normalize(words), until(words, _ENDS)
  if not (gait or verb in lexicon.LIGHT_VERBS) or has_phrase(whole, "then, in place, on spot") or not (
      lexicon.LIMBS | {"air"}).isdisjoint(words if gait else whole.split()):
    return ()
  path = normalize(word for word in words if word not in _SIZES).replace("s circle", "s in circle")  # "walks a circle"
  shape = lookup(_SHAPES, f"{path}. ", "")
  shapes = [PathShape(shape, _side_of(path, whole))] if shape in ("circle", "u-turn", "curve") else []
  if shape in ("zigzag", "figure-eight") or shape == "straight" and not has_phrase(
      whole, "veer*, turn*, curv*, swerv*, back, forth"):
    shapes = [PathShape(shape, "")]
  if not gait:
    return tuple(shape for shape in shapes if shape.kind == "u-turn")
  paces = [*dict.fromkeys(pace for word in words if (pace := pace_of(word)))]
  if not paces:
    paces = ["quickly"] if "quickly" in manner else ["usual"] if gait == "walk" and set(manner) <= {"slowly"} else []
  if has_phrase(path, _OTHERWISE) or has_phrase(whole, _CHANGES) or len(paces) > 1:
    return tuple(shapes)
  return (*shapes, *(PathShape(pace, gait) for pace in paces))


def _side_of(path, whole):
  sides = [side for side, phrases in _SIDES if has_phrase(path, phrases)]
  return sides[0] if len(sides) == 1 else "" if sides else lookup(_TURNING, whole, "")


def course_of(verb: str, part: str, whole: str) -> str | None:
  """The side that a walk leads to, "" for a walk elsewhere, None for other actions."""
  if not is_gait(verb) and verb not in ("go", "move") or part not in ("legs", "body", ""):
    return None
  if has_phrase(whole, _NO_COURSE):
    return ""
  words = [word for word in whole.split() if not word.endswith("ly")]
  for before, side, thing in zip(words, words[1:], [*words[2:], ""]):
    if side in lexicon.SIDES and thing not in _SIDED and (
        before in ("to", "toward", "towards") or side == words[1] and thing != "and"):
      return side
  return ""


def path_shapes_of(actions: Sequence[Any]) -> list[PathShape]:
  """Shape and pace of the path of actions of which exactly one moves the body; [] for others.

  With a separate turn only the pace is kept; "makes a u-turn" gives its shape to a walk without one.
  """
  moving = [action for action in actions
            if action.part in ("legs", "body", "") and action.verb not in lexicon.STAYING_VERBS | {"jump"}]
  turns = any(is_a(action.verb, *_TURNS) for action in moving)
  going = [action for action in moving if action.verb not in lexicon.LIGHT_VERBS and not is_a(action.verb, *_TURNS)]
  for action in moving:
    if action.verb in lexicon.LIGHT_VERBS and action.slots.shapes:
      return [] if any(shape.kind in BENT for walk in going for shape in walk.slots.shapes) else [*action.slots.shapes]
  if len(going) != 1:
    return []
  return [shape for shape in going[0].slots.shapes if shape.kind in PACES or not turns]


def min_duration(actions: Sequence[Any]) -> float:
  """Least seconds for a circle or a figure of eight, walking or running; 0 for other paths."""
  circles = max((_CIRCLES.get(shape.kind, 0.0) for shape in path_shapes_of(actions)), default=0.0)
  return circles * _CIRCLE_SECONDS["run" if any(is_a(action.verb, "run") for action in actions) else "walk"]


def without_shape(text: str) -> str:
  """The text without its figure of eight, to which the correct step bends a walk: "walks" of "walks in a figure 8"."""
  return re.sub(r"(?: in| along| on)? a figure-eight\b", "", lexicon.spelt(text), flags=re.IGNORECASE)


def with_explicit_side(text: str, number: int) -> str:
  """The text with a side after its circle: "in a circle to the left" for odd numbers, right for even ones.

  A text with no circle, or with several, stays as it is.
  """
  circles = re.findall(_A_CIRCLE, text)
  return re.sub(_A_CIRCLE, rf"\g<0> to the {'left' if number % 2 else 'right'}", text) if len(circles) == 1 else text
