"""Excerpts of sitting down and of standing up, cut out of clips that show both.

The kinematic rules do not know chairs, so only clips whose captions mention sitting are used.
"""
import re
from collections.abc import Iterator

from motion_jax.analysis.describe import FPS
from motion_jax.analysis.rest import sittings
from motion_jax.data.augment.parts import new_clip
from motion_jax.data.clip import Clip

_SITS = re.compile(r"\b(sits?|sitting|stool|chair|seat)\b", re.IGNORECASE)
_NOT_ON_A_CHAIR = re.compile(r"playground|climb|floor|ground|leg", re.IGNORECASE)
_STANDS = (0.3, 1.5)      # seconds of standing or sitting kept before and after
_SAID = {"sit": ("a person sits down.", "someone takes a seat.", "a person sits down on a chair.",
                 "the person sits on a stool."),
         "rise": ("a person stands up from a chair.", "someone gets up from a seat.", "a person stands up.",
                  "the person gets up from a stool.")}


def seats(parts, rng) -> Iterator[Clip | None]:
  """Excerpts of sitting down or standing up: "sits down", "stands up from a chair"."""
  ways = [(part, kind, *frames) for part in parts if _SITS.search(part.words)
          and not _NOT_ON_A_CHAIR.search(part.name) for kind, *frames in sittings(part.joints, FPS)]
  number = 0
  while ways:
    number += 1
    part, kind, begin, first, past, end = ways[rng.integers(len(ways))]
    before, behind = (round(float(rng.uniform(*_STANDS)) * FPS) for _ in range(2))
    first, past = max(first - before, begin), min(past + behind, end)
    yield new_clip("seat", number, part.joints[first:past], _SAID[kind], part, kind)

