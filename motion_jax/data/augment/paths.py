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
# {shape: (what is said of it, what `motion.events` must call it)}
_SHAPES = {
    "circle": ("in a circle to the {side}", "around in a circle, turning {side}", "in a {clock} circle", "in a circle"),
    "curve": ("in a curve to the {side}", "in an arc to the {side}", "and curves to the {side}",
              "along a curved path to the {side}"),
    "u-turn": ("in a half circle to the {side}", "and makes a u-turn to the {side}",
               "in a u-turn to the {side}", "and turns around to the {side}", "and turns around"),
    "zigzag": ("in a zigzag", "along a zigzag path", "in a zigzag line"),
}


def bent_paths(parts, rng) -> Iterator[Clip | None]:
  """Straight walks and runs forward, each attempt on another path: half of them circles where there is room."""
  ways = [(one, event) for one in parts for event in one.events if event.kind in SMALLEST and event.way == "forward"
          and event.path == "straight" and one.known
          and all(other is event or other.kind == "still" for other in one.events)]
  number = 0
  while ways:
    one, event = ways[rng.integers(len(ways))]
    number += 1
    yield _bent(one, event, rng, number)


def _bent(one, event, rng, number):
  joints = one.joints[:MOST]
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
  made = bent(joints, lambda gone: sign * angle(gone))
  side = "left" if left else "right"
  events = find_events(made, FPS)
  found = [other for other in events if other.kind in SMALLEST]
  turns = {other.side for other in events if other.kind == "turn"}
  sides = {"zigzag": ({"left", "right"}, {"left"}, {"right"}, set()), "curve": ({side}, set())}.get(shape, ({side},))
  if len(found) != 1 or found[0].path != shape or turns not in sides:
    return None
  words = {"side": side, "clock": "counterclockwise" if left else "clockwise"}
  said = [_on_a_path(caption.text, phrase.format(**words)) for caption in one.clip.captions
          for phrase in [_SHAPES[shape][rng.integers(len(_SHAPES[shape]))]]]
  described = sentences(events, (len(made) - 1) / FPS, key=f"{one.clip.id}{number}", subject=one.subject, plain=PLAIN)
  captions = [*filter(None, said), *described]
  return new_clip("bent", number, made, captions, one, f"{event.kind} {shape}") if captions else None


def _on_a_path(text, phrase):
  """A caption of a straight way, of one on a path; "" where it says more of the way than that."""
  found = _GOES.search(text)
  if not found or _OTHER.search(text[:found.start()] + text[found.end():]):
    return ""
  verb = text[found.start():found.end()][:-len(found[4] or "") or None]
  return f"{text[:found.start()]}{verb} {phrase}{text[found.end():]}"


def _eased(u):
  """From 0 to 1 at an even rate, but for a tenth at each end in which the rate comes and goes."""
  u, soft = np.clip(u, 0, 1), 0.1
  rise = lambda x: x ** 2 / (2 * soft)
  whole = 1 - soft
  return np.where(u < soft, rise(u), np.where(u > 1 - soft, whole - rise(1 - u), u - soft / 2)) / whole
