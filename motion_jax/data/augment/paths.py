"""Bend straight walks and runs onto circles, arcs, u-turns and zigzags (`motion.root_paths`), with captions to match.

A clip is kept only if the kinematic rules (`analysis`) find the path and its side in it.
"""
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS, sentences
from motion_jax.analysis.events import find_events
from motion_jax.data.augment.parts import MOST, PLAIN, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.root_paths import SMALLEST, bent, course

_GOES = re.compile(r"\b(is )?(walk|runn?|jogg?|strid|stroll|sprint|dash)(e?s|ing)\b(( straight)? (forward|ahead))?")
_OTHER = re.compile(r"\b(left|right|turn\w*|and|then|back\w*|line|straight|diagonal\w*|sideways|steps?)\b|,")
# {shape, as named by `analysis.events`: phrases for captions}
_SHAPES = {
    "circle": ("in a circle to the {side}", "around in a circle, turning {side}", "in a {clock} circle", "in a circle"),
    "curve": ("in a curve to the {side}", "in an arc to the {side}", "and curves to the {side}",
              "along a curved path to the {side}"),
    "u-turn": ("in a half circle to the {side}", "and makes a u-turn to the {side}",
               "in a u-turn to the {side}", "and turns around to the {side}", "and turns around"),
    "zigzag": ("in a zigzag", "along a zigzag path", "in a zigzag line"),
}


def bent_paths(parts, rng) -> Iterator[Clip | None]:
  """Straight forward walks and runs, bent onto a random path in each attempt."""
  ways = [(part, event) for part in parts for event in part.events if event.kind in SMALLEST and event.way == "forward"
          and event.path == "straight" and part.known
          and all(other is event or other.kind == "still" for other in part.events)]
  number = 0
  while ways:
    part, event = ways[rng.integers(len(ways))]
    number += 1
    yield _bent(part, event, rng, number)


def _bent(part, event, rng, number):
  joints = part.joints[:MOST]
  whole, smallest, left = course(joints)[1][-1], SMALLEST[event.kind], bool(rng.random() < 0.5)
  shape = ("circle", "circle", "u-turn", "curve", "zigzag")[rng.integers(5)]
  chance, place = rng.random(), rng.random()
  if shape == "zigzag":
    wave = whole / (1.9 + 0.6 * chance)
    swing = min(0.65, wave / (2 * np.pi * smallest))
    angle = lambda gone: swing * np.sin(2 * np.pi * gone / wave)
  else:
    total = {"circle": 2 * np.pi * (1 + 0.1 * chance), "u-turn": np.pi, "curve": np.radians(50 + 90 * chance)}[shape]
    least = smallest * total * (1.0 if shape == "circle" else 1.1)
    way = {"circle": whole, "curve": max(least, 0.7 * whole), "u-turn": min(whole, least * (1 + 0.5 * chance))}[shape]
    if whole < least:
      return None
    begin = place * (whole - way)
    angle = lambda gone: total * _eased((gone - begin) / way)
  sign = 1 if left else -1
  joints_bent = bent(joints, lambda gone: sign * angle(gone))
  side = "left" if left else "right"
  events = find_events(joints_bent, FPS)
  walks = [other for other in events if other.kind in SMALLEST]
  turns = {other.side for other in events if other.kind == "turn"}
  sides = {"zigzag": ({"left", "right"}, {"left"}, {"right"}, set()), "curve": ({side}, set())}.get(shape, ({side},))
  if len(walks) != 1 or walks[0].path != shape or turns not in sides:
    return None
  words = {"side": side, "clock": "counterclockwise" if left else "clockwise"}
  said = [_on_a_path(caption.text, phrase.format(**words)) for caption in part.clip.captions
          for phrase in [_SHAPES[shape][rng.integers(len(_SHAPES[shape]))]]]
  described = sentences(events, (len(joints_bent) - 1) / FPS, key=f"{part.clip.id}{number}", subject=part.subject,
                        plain=PLAIN)
  captions = [*filter(None, said), *described]
  return new_clip("bent", number, joints_bent, captions, part, f"{event.kind} {shape}") if captions else None


def _on_a_path(text, phrase):
  """A caption of a straight path, changed to another path; "" if it says more about the path."""
  match = _GOES.search(text)
  if not match or _OTHER.search(text[:match.start()] + text[match.end():]):
    return ""
  verb = text[match.start():match.end()][:-len(match[4] or "") or None]
  return f"{text[:match.start()]}{verb} {phrase}{text[match.end():]}"


def _eased(u):
  """Progress from 0 to 1 at constant speed, with acceleration in the first and last tenth."""
  u, soft = np.clip(u, 0, 1), 0.1
  rise = lambda x: x ** 2 / (2 * soft)
  whole = 1 - soft
  return np.where(u < soft, rise(u), np.where(u > 1 - soft, whole - rise(1 - u), u - soft / 2)) / whole
