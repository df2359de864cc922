"""Sampling options of MoMask."""
import dataclasses

from motion_jax.models.options import SamplingOptions, number
from motion_jax.utils.numerals import GUIDANCE, STEPS


@dataclasses.dataclass(frozen=True)
class MomaskSampling(SamplingOptions):
  """Choices of masked decoding and of the residual levels."""
  num_iterations: int | None = number("number of decoding rounds; each keeps the codes that are most certain", STEPS)
  temperature: float | None = number("temperature of the draws of level 0", (0, 100), float, usual=1.0)
  threshold: float | None = number("share of the codes that are never drawn, the least likely ones", (0, 1), float,
                                   usual=0.9)
  residual_scale: float | None = number("classifier-free guidance scale of the residual levels", GUIDANCE, float,
                                        usual=5.0)
  residual_temperature: float | None = number("temperature of the draws of the residual levels", (0, 100), float,
                                              usual=1.0)


OPTIONS = MomaskSampling
