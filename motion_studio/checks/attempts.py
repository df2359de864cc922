"""How a motion that violates requirements of its prompt is sampled again: other words, another weight of words."""
from collections.abc import Sequence
from typing import Any

from motion_studio.checks import path_shapes as ways

LOUDER = 2.0  # times the guidance of another attempt; of 24 punches of a named hand 6 show with the usual one, 16 so
SOFTER = 0.5  # times the guidance where the words were overdone
FIRST_RESAMPLED = 1 << 20  # added to an attempt's number, so that its key is unique


def said_again(prompt: str, requirements: Sequence[Any], number: int) -> str:
  """The words of another attempt: a circle that may go either way gets a side, for a model may know only such."""
  either = any(one.kind == "circle" and not one.side for one in requirements)
  return ways.with_a_side(prompt, number) if either else prompt


def reweighed(model: Any, sampling: dict[str, Any], factor: float) -> dict[str, Any]:
  """The choices of sampling with this many times the guidance, but no less than 1; as they are where it is given."""
  scale = model.sampling(**sampling).guidance_scale
  return sampling if scale <= 1 or sampling.get("guidance_scale") is not None else (
      dict(sampling) | dict(guidance_scale=max(factor * scale, 1.0)))
