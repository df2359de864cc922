"""Excerpts of sitting down and of standing up, cut out of clips that show both.

The kinematic rules do not know chairs, so only clips whose captions mention sitting are used.
"""
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS
from motion_jax.analysis.signals import Body
from motion_jax.data.augment.parts import new_clip
from motion_jax.data.clip import Clip

_SITS = re.compile(r"\b(sits?|sitting|stool|chair|seat)\b", re.IGNORECASE)
_NOT_ON_A_CHAIR = re.compile(r"playground|climb|floor|ground|leg", re.IGNORECASE)
_LOW, _HIGH = 0.86, 0.95  # of the standing pelvis' height, of one that sits and of one that stands
_LEAST = 0.5              # seconds of sitting
_STANDS = (0.3, 1.5)      # seconds of standing, and of sitting, that are kept on either side
_SAID = {"sit": ("a person sits down.", "someone takes a seat.", "a person sits down on a chair.",
                 "the person sits on a stool."),
         "rise": ("a person stands up from a chair.", "someone gets up from a seat.", "a person stands up.",
                  "the person gets up from a stool.")}


def seats(parts, rng) -> Iterator[Clip | None]:
  """The one or the other out of a clip of both: "sits down", "stands up from a chair"."""
  ways = [(part, kind, *frames) for part in parts if _SITS.search(part.words)
          and not _NOT_ON_A_CHAIR.search(part.name) for kind, *frames in sittings(part.joints)]
  number = 0
  while ways:
    number += 1
    part, kind, begin, first, past, end = ways[rng.integers(len(ways))]
    before, behind = (round(float(rng.uniform(*_STANDS)) * FPS) for _ in range(2))
    first, past = max(first - before, begin), min(past + behind, end)
    yield new_clip("seat", number, part.joints[first:past], _SAID[kind], part, kind)


def sittings(joints) -> list[tuple[str, int, int, int, int]]:
  """("sit" or "rise", frames: where standing or sitting begins that comes before, where the way down or up begins,
  where it is over, and where what comes then is over) of joints (T, 22, 3)."""
  body = Body(np.asarray(joints, np.float64), FPS)
  height = body.pelvis / np.percentile(body.pelvis, 95)
  sitting = (height < _LOW) & (body.knees.min(1) < 130) & (body.speed < 0.3) & (body.trunk < 60) & (body.pelvis > 0.3)
  standing = (height > _HIGH) & (body.knees.max(1) > 140)
  found = []
  for first, past in body.spans(sitting, least=_LEAST, gap=0.3):
    before, after = np.flatnonzero(standing[:first]), np.flatnonzero(standing[past:]) + past
    if len(before) and first - before[-1] < 2.5 * FPS:
      down = int(before[-1])
      begin = down - int(np.argmin(standing[:down + 1][::-1])) + 1 if not standing[:down + 1].all() else 0
      found.append(("sit", begin, down, first, past))
    if len(after) and after[0] - past < 2.5 * FPS:
      up = int(after[0])
      end = up + int(np.argmin(standing[up:])) if not standing[up:].all() else len(joints)
      found.append(("rise", first, past, up, end))
  return found
