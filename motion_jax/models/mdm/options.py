"""How an MDM model is sampled."""
import dataclasses
from typing import TYPE_CHECKING, Any

from motion_jax.models.options import SamplingOptions, choice, number
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import STEPS

if TYPE_CHECKING:
  from ml_collections import ConfigDict


@dataclasses.dataclass(frozen=True)
class MdmSampling(SamplingOptions):
  """Choices of sampling with MDM and DiP."""
  num_steps: int | None = number("number of diffusion steps, at most those of training", STEPS)
  solver: str | None = choice("solver: ancestral draws noise in every step, ddim none", ("ancestral", "ddim"),
                              usual="ancestral")
  part: str | None = choice("which part of the body an edit generates in its new frames", (
      "body", "upper_body", "lower_body"), usual="body")

  def resolved(self, config: "ConfigDict", **usual: Any) -> "MdmSampling":
    """As of any method; never more steps than training had."""
    found = super().resolved(config, **usual)
    if found.num_steps > config.diffusion.num_steps:
      raise InputError(f"got {found.num_steps} sampler steps, this model was trained with "
                       f"{config.diffusion.num_steps}; give at most as many")
    return found


OPTIONS = MdmSampling
