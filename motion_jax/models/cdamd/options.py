"""Sampling options of CDAMD."""
import dataclasses
from typing import TYPE_CHECKING, Any

from motion_jax.models.options import SamplingOptions, choice, number, switch
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import STEPS

if TYPE_CHECKING:
  from ml_collections import ConfigDict

ORDERS = ("random", "left_to_right")
MASKS = ("causal", "dccm", "bcm", "bidirectional")
SOLVERS = ("euler", "heun", "midpoint", "rk4", "dopri5", "ddpm")


@dataclasses.dataclass(frozen=True)
class CdamdSampling(SamplingOptions):
  """Choices of unmasking, and of the diffusion head that makes what is unmasked."""
  num_iterations: int | None = number("number of decoding iterations; each unmasks some latents", STEPS)
  order: str | None = choice("order in which latents are unmasked", ORDERS)
  mask: str | None = choice("attention mask: which latents a latent may attend to", MASKS)
  solver: str | None = choice("solver: midpoint (default), euler, heun, rk4 or dopri5; ddpm for a model trained as "
                              "a DDPM", SOLVERS, listed=False)
  num_steps: int | None = number("number of solver steps in each decoding iteration", STEPS)
  unmasked_only: bool | None = switch("run the diffusion head only on the latents that an iteration unmasks; false: on "
                                      "all masked latents, as in the released code")
  temperature: float | None = number("scale of the noise that DDPM steps add", (0, 100), float, usual=1.0)
  shared_noise: float | None = number("share of the noise variance that all latents of a motion have in common: 0 "
                                      "draws each independently (jittery), 1 is smoothest", (0, 1),
                                      float, usual=0.0)

  def resolved(self, config: "ConfigDict", **usual: Any) -> "CdamdSampling":
    """As of any method; a model that was trained by the other diffusion than its config samples by takes its own."""
    ddpm = config.loss.diffusion == "ddpm"
    if self.solver is None and (config.sampler.solver == "ddpm") != ddpm:
      usual = (dict(solver="ddpm", num_steps=config.loss.ddpm_steps) if ddpm else
               dict(solver="midpoint", num_steps=10)) | usual
    options = super().resolved(config, **usual)
    if (options.solver == "ddpm") != ddpm:
      raise InputError(f"got solver {options.solver!r} for a model that was trained by {config.loss.diffusion}")
    return options


OPTIONS = CdamdSampling
