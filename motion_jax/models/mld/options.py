"""Sampling options of MLD."""
import dataclasses

from motion_jax.models.options import SamplingOptions, choice, number
from motion_jax.utils.numerals import STEPS


@dataclasses.dataclass(frozen=True)
class MldSampling(SamplingOptions):
  """Choices of sampling one latent for a whole motion."""
  num_steps: int | None = number("number of diffusion steps, at most those of training", STEPS)
  solver: str | None = choice("solver: ddim draws no noise, ancestral draws it in every step", ("ddim", "ancestral"),
                              usual="ddim")


OPTIONS = MldSampling
