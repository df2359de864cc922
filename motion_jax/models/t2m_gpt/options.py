"""Sampling options of T2M-GPT."""
import dataclasses

from motion_jax.models.options import SamplingOptions, choice, number

DRAWS = ("categorical", "greedy")


@dataclasses.dataclass(frozen=True)
class T2mGptSampling(SamplingOptions):
  """How each next code is chosen; there is no guidance."""
  guidance_scale: float | None = number("1: this method has no guidance", (1, 1), float, usual=1.0)
  draw: str | None = choice("how the next code is chosen: drawn, or the likeliest one", DRAWS, usual="categorical")
  temperature: float | None = number("temperature of the draws", (0.01, 100), float, usual=1.0)


OPTIONS = T2mGptSampling
