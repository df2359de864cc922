"""How a CMDM model is sampled."""
import dataclasses
from typing import TYPE_CHECKING, Any

from motion_jax.models.options import SamplingOptions, choice, number
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import CONTEXT, MEMORY, SIDE_GUIDANCE, STEPS

if TYPE_CHECKING:
  from ml_collections import ConfigDict

SCHEDULES = ("fss", "ar", "full")
SOLVERS = {"flow": ("euler", "heun"), "ddpm": ("ancestral", "ddim")}  # by what the network learned to predict


@dataclasses.dataclass(frozen=True)
class CmdmSampling(SamplingOptions):
  """Choices of frame-wise sampling."""
  schedule: str | None = choice("frame-wise sampling (fss), block after block (ar), or all at once (full)", SCHEDULES,
                                usual="fss")
  num_steps: int | None = number("sampling steps K", STEPS, flag="steps")
  lag: int | None = number("sampling steps between the starts of two blocks, of schedule fss", STEPS)
  solver: str | None = choice("euler (the usual one) or heun; ancestral or ddim for a model trained as a DDPM",
                              (*SOLVERS["flow"], *SOLVERS["ddpm"]), listed=False)
  context: int | None = number("latents (4 frames each) that a latent attends to; by default the training length",
                               CONTEXT, unit="latents")
  memory: int | None = number("latents before new words, in whole blocks, that what is made after them attends to (all "
                              "within the context)", MEMORY, unit="latents")
  side_guidance: float | None = number("how much farther apart the words of a sentence that says which leg and those "
                                       "of the same sentence with the other leg are made; 0 for words as they are",
                                       SIDE_GUIDANCE, float, usual=0.0)

  def resolved(self, config: "ConfigDict", **usual: Any) -> "CmdmSampling":
    learned = "ddpm" if config.model.get("predicts") == "ddpm" else "flow"
    known = SOLVERS[learned]
    found = super().resolved(config, **{"solver": config.sampler.get("solver") or known[0]} | usual)
    if found.solver not in known:
      raise InputError(f"got solver {found.solver!r}, this model knows {', '.join(known)}: it was trained to predict "
                       f"{'the noise of a DDPM' if learned == 'ddpm' else 'a velocity'}")
    return found

  @property
  def steps_apart(self) -> int:
    """Steps between the starts of two blocks: the lag, all steps of "ar", none of "full"."""
    steps: dict[str | None, Any] = {"fss": self.lag, "ar": self.num_steps, "full": 0}
    return steps[self.schedule]

  def about(self) -> dict[str, Any]:
    return super().about() | dict(lag=self.steps_apart)


OPTIONS = CmdmSampling
