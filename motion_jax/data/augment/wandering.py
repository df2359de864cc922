"""Bend walks, runs and other locomotion onto random paths: for training on constraints.

In captured clips the past motion predicts the path, so a network that sees the past learns little from a path
constraint. Here only the constraint determines the path. Captions that name no path are kept.
"""
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS
from motion_jax.data.augment.parts import MOST, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.root_paths import SMALLEST, bent, course
from motion_jax.motion.smoothing import gaussian_filter1d

_NAMES_A_PATH = re.compile(r"\b(left|right|turn\w*|line|straight|circ\w+|curv\w+|arc|zigzag|diagonal\w*|corner\w*|"
                           r"u-turn|path|square|clockwise|counterclockwise|around|round)\b")
_LEAST = 2.0         # metres: least length of a clip's course
_BITS = (0.4, 2.5)   # metres: length of a segment of constant curvature
_FAST = 2.2          # metres a second above which the smallest radius of a run applies
_STRAIGHT = 0.25     # share of straight segments
_SOFT = 0.15         # metres, sigma of the smoothing between segments


def wandering(parts, rng) -> Iterator[Clip | None]:
  """Clips with locomotion, each attempt along a random path of straight and curved segments."""
  ways = []
  for part in parts:
    said = [caption.text for caption in part.clip.captions if not _NAMES_A_PATH.search(caption.text)]
    joints = part.joints
    if not part.known or len(joints) > MOST:  # stairs; of long clips a captioned action might be cut off
      continue
    gone = course(joints)[1]
    if said and gone[-1] > _LEAST:
      ways.append((part, said, joints, gone))
  number = 0
  while ways:
    number += 1
    part, said, joints, gone = ways[rng.integers(len(ways))]
    fast = np.percentile(np.gradient(gone), 90) * FPS > _FAST
    angle = _turning(gone[-1], SMALLEST["run" if fast else "walk"], rng)
    yield new_clip("wandering", number, bent(joints, angle), said, part, "on a path of its own")


def _turning(length, smallest, rng):
  """angle(l) of a path of random segments, with radii of at least `smallest` metres."""
  ends, curves = [0.0], []
  while ends[-1] < length:
    ends.append(ends[-1] + rng.uniform(*_BITS))
    curves.append(0.0 if rng.random() < _STRAIGHT else rng.uniform(-1, 1) / smallest)
  along = np.arange(0.0, ends[-1] + _SOFT, _SOFT / 10)
  angles = np.interp(along, ends, np.append(0.0, np.cumsum(np.diff(ends) * curves)))
  smooth = gaussian_filter1d(angles, 10, mode="nearest")
  return lambda gone: np.interp(gone, along, smooth)
