"""Leans of the trunk from the words of an action: "leans to the left", "sways back and forth", "tilts backward"."""
import functools
from typing import NamedTuple

from motion_jax.text.morphology import is_participle
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.hand_places import without_hands
from motion_jax_studio.language.words import before, first_of, said, tokens

_VERBS = {"lean", "sway", "tilt", "rock", "slouch", "slump", "hunch"}
_SWAYING = {"sway", "rock"}
_OTHER_THINGS = {"head", "neck", "hand", "hands", "arm", "arms", "leg", "legs", "foot", "feet", "hip", "hips", "heel",
                 "heels", "toe", "toes", "on", "against", "chair", "seat", "sofa", "couch", "ground", "floor", "while",
                 "then"}
_WAYS = (
    ((0, 1, True), "back and forth, forward and backward, forwards and backwards, front to back"),
    ((1, 0, True), "side to side, left and right, right and left, left to right, right to left"),
    ((1, 0, False), "left"), ((-1, 0, False), "right"), ((0, -1, False), "back, backward, backwards"),
    ((0, 1, False), "forward, forwards, over, down, ahead, in"))


class Lean(NamedTuple):
  """A lean of the trunk."""
  way: tuple[int, int]  # to the left, ahead: 1, 0 or -1
  sways: bool           # between this direction and the opposite one, repeatedly


@functools.lru_cache(maxsize=1 << 12)
def lean_of(verb: str, text: str) -> Lean | None:
  """The lean of an action; None if its words name none."""
  if verb not in _VERBS:
    return None
  words = before(tokens(without_hands(text)), {","})
  of_a_thing = words[1:2] and words[1] in lexicon.DETERMINERS | lexicon.POSSESSIVES and (
      words[2:3] not in (("left",), ("right",), ("side",), ("front",), ("back",), ("other",)))
  if of_a_thing or not _OTHER_THINGS.isdisjoint(words) or any(map(is_participle, words[1:])):
    return None
  left, ahead, sways = first_of(_WAYS, said(words), (1, 0, True) if verb in _SWAYING else (0, 1, False))
  return Lean((left, ahead), sways)
