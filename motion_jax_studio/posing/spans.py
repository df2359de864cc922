"""When the segments of a plan are in a motion, and how postures come and go in them."""
from collections.abc import Sequence

import numpy as np

from motion_jax.models.results import Motion
from motion_jax.motion.smoothing import smoothstep
from motion_jax.shapes import Float
from motion_jax_studio.language import Segment

_RISE, _FALL = 0.8, 0.7  # seconds in which a posture is taken, and goes over into the sampled motion
_SHARE = 0.4             # of the time of an action, at most, in which it is taken


def bounds_of(motion: Motion, segments: Sequence[Segment]) -> list[tuple[int, int]]:
  """(first frame, frame past the last) of each segment of a motion."""
  if len(segments) == 1:
    return [(0, motion.num_frames)]
  return [(round(one.start * motion.fps), round(one.end * motion.fps)) for one in motion.captions]


def rising(count: int, first: int, past: int, fps: float, at_once: bool = False) -> Float[np.ndarray, " t"]:
  """Weight (count,) of a posture: from 0 to 1 in the first of its frames, first to past, and back to 0 after them.

  at_once: it is 1 from the first frame of a motion that begins with it.
  """
  k = np.arange(count)
  rise = np.ones(count) if at_once and first == 0 else (k - first) / max(min(_RISE * fps, _SHARE * (past - first)), 1)
  return smoothstep(np.minimum(rise, 1 - (k - past + 1) / (_FALL * fps)))
