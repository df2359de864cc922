"""Sampling options of MotionStreamer."""
import dataclasses

from motion_jax.models.options import SamplingOptions, choice, number
from motion_jax.utils.numerals import STEPS


@dataclasses.dataclass(frozen=True)
class MotionStreamerSampling(SamplingOptions):
  """Choices of sampling latent after latent."""
  num_steps: int | None = number("diffusion steps of each latent, at most those of training", STEPS)
  temperature: float | None = number("size of the noise of these steps (1)", (0, 10), float, usual=1.0)
  ends: str | None = choice("where a motion of one prompt ends: at its length, or before it at the latent by which the "
                            "network says that it has ended", ("length", "itself"), usual="length")
  stop_distance: float | None = number("how near a latent is to the one that ends a motion (0.1)", (0, 1e6), float,
                                       usual=0.1)
  clip_latents: float | None = number("bound of the clean latents that diffusion steps mean, such as 5 deviations; 0: "
                                      "none, as released (0)", (0, 1e6), float, usual=0.0)


OPTIONS = MotionStreamerSampling
