"""Requests for many motions: their plans, and batches that fit in memory."""
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax.utils.errors import InputError
from motion_jax_studio.language import Plan

BATCH_FRAMES = 16_000  # frames of all motions of one batch
MOST_FRAMES = 400_000  # frames of all motions of one run


class Request(NamedTuple):
  """One motion: its prompt, frames (None: as long as the plan takes) and seed."""
  prompt: str
  frames: float | None = None
  seed: int = 0


class Planned(NamedTuple):
  """The result of planning: for each request its plan (None: the prompt as given) and number of frames; notes on all
  prompts."""
  plans: list[Plan | None]
  frames: list[int]
  notes: list[str]


def batches(frames: Sequence[float], fps: float) -> list[slice]:
  """Slices that split motions of these lengths into batches of at most `BATCH_FRAMES` frames, or of one motion.

  Raises InputError for more than `MOST_FRAMES` together.
  """
  total, count = float(sum(frames)), len(frames)
  if not total <= MOST_FRAMES:
    raise InputError(f"got {count:,} motion{'s' * (count != 1)} of {total / fps / 3600:.3g} hours together, expected "
                     f"at most {MOST_FRAMES / fps / 3600:.1f} in one run; use several runs with other seeds")
  size = max(1, int(BATCH_FRAMES // max(frames)))
  return [slice(first, first + size) for first in range(0, count, size)]
