"""Frames of a plan's segments in a motion, and weights that blend postures in and out."""
from collections.abc import Sequence

import numpy as np

from motion_jax.models.results import Motion
from motion_jax.motion.smoothing import smoothstep
from motion_jax.shapes import Float
from motion_jax_studio.language import Segment

_RISE, _FALL = 0.8, 0.7  # seconds to blend a posture in, and out
_SHARE = 0.4             # largest share of an action's time for blending in


def bounds_of(motion: Motion, segments: Sequence[Segment]) -> list[tuple[int, int]]:
  """(first frame, frame past the last) of each segment of a motion."""
  if len(segments) == 1:
    return [(0, motion.num_frames)]
  return [(round(caption.start * motion.fps), round(caption.end * motion.fps)) for caption in motion.captions]


def rising(count: int, first: int, past: int, fps: float, from_start: bool = False) -> Float[np.ndarray, " t"]:
  """Weight (count,) of a posture in frames first to past: rises from 0 to 1 at their beginning, and falls after them.

  from_start: 1 from the start for a posture in which the motion begins (first = 0).
  """
  k = np.arange(count)
  frames = max(min(_RISE * fps, _SHARE * (past - first)), 1)
  rise = np.ones(count) if from_start and first == 0 else (k - first) / frames
  return smoothstep(np.minimum(rise, 1 - (k - past + 1) / (_FALL * fps)))
