"""Sampling options of MDM."""
import dataclasses

from motion_jax.models.options import SamplingOptions, choice, number
from motion_jax.utils.numerals import STEPS


@dataclasses.dataclass(frozen=True)
class MdmSampling(SamplingOptions):
  """Choices of sampling with MDM and DiP."""
  num_steps: int | None = number("number of diffusion steps, at most those of training", STEPS)
  solver: str | None = choice("solver: ancestral draws noise in every step, ddim none", ("ancestral", "ddim"),
                              usual="ancestral")
  part: str | None = choice("which part of the body an edit generates in its new frames", (
      "body", "upper_body", "lower_body"), usual="body")


OPTIONS = MdmSampling
