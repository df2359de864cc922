"""Where a body leans by the words of an action: "leans to the left", "sways back and forth", "tilts backward"."""
import re
from typing import NamedTuple

from motion_jax.text.morphology import is_participle
from motion_jax_studio.language.hand_places import without_hands
from motion_jax_studio.language.segments import Action

_VERBS = {"lean", "sway", "tilt", "rock", "slouch", "slump", "hunch"}
_OTHER_THINGS = re.compile(r"\b(?:head|neck|hands?|arms?|legs?|foot|feet|hips?|heels?|toes?|on|against|chair|seat|"
                           r"sofa|couch|ground|floor|while|then)\b|^(?:\w+ly )*\w+ (?:a|an|the|his|her|their) "
                           r"(?!left|right|side|front|back|other)")
_WAYS = tuple((re.compile(rf"\b(?:{words})\b"), way) for words, way in (
    (r"back and forth|forwards? and backwards?|front to back", (0, 1)),
    (r"side to side|left and right|right and left|left to right|right to left", (1, 0)),
    (r"left", (1, 0)), (r"right", (-1, 0)), (r"backwards?|back", (0, -1)), (r"forwards?|over|down|ahead|in", (0, 1))))
_TO_AND_FRO = re.compile(r"\b(?:side to side|and forth|and backwards?|to back|(?:left|right) (?:and|to) "
                         r"(?:left|right))\b")


class Lean(NamedTuple):
  """A lean of the trunk."""
  way: tuple[int, int]  # to the left, ahead: 1, 0 or -1
  sways: bool           # to there and to the other way, again and again


def lean_of(action: Action) -> Lean | None:
  """Where an action has the trunk lean, None where its words say no such thing."""
  said = without_hands(action.words.lower()).split(",")[0]
  if action.verb not in _VERBS or _OTHER_THINGS.search(said) or any(map(is_participle, said.split()[1:])):
    return None
  swaying = action.verb in ("sway", "rock")
  way = next((way for words, way in _WAYS if words.search(said)), (1, 0) if swaying else (0, 1))
  named = any(words.search(said) for words, _ in _WAYS)
  return Lean(way, bool(_TO_AND_FRO.search(said)) or swaying and not named)
