"""Sampling options of CMDM."""
import dataclasses
from typing import TYPE_CHECKING, Any

from motion_jax.models.options import SamplingOptions, choice, number, switch
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import CONTEXT, CONTRAST, MEMORY, STEPS

if TYPE_CHECKING:
  from ml_collections import ConfigDict

SCHEDULES = ("fss", "ar", "full")
WAYS = ("stream", "chain")  # of several prompts: changed within one run, or one run per prompt
SOLVERS = {"flow": ("euler", "heun"), "ddpm": ("ancestral", "ddim")}  # by what the network learned to predict


@dataclasses.dataclass(frozen=True)
class CmdmSampling(SamplingOptions):
  """Choices of frame-wise sampling."""
  schedule: str | None = choice("sampling schedule: frame-wise (fss), block after block (ar) or all frames at once "
                                "(full)", SCHEDULES, usual="fss")
  num_steps: int | None = number("number of sampling steps K", STEPS)
  lag: int | None = number("sampling steps between the starts of two blocks, with --schedule fss", STEPS)
  solver: str | None = choice("solver: euler (default) or heun; ancestral or ddim for a model trained as a DDPM",
                              (*SOLVERS["flow"], *SOLVERS["ddpm"]), listed=False)
  context: int | None = number("attention window in latents of 4 frames; default: the training length",
                               CONTEXT, unit="latents")
  memory: int | None = number("how many latents before a new prompt remain visible after it, in whole blocks; default: "
                              "the whole context", MEMORY, unit="latents")
  contrast_scale: float | None = number("contrast guidance: how far the embedding of a prompt is moved away from "
                                        "that of its negative prompt, such as the same sentence with the other leg; 0 "
                                        "turns it off", CONTRAST, float, key="side_guidance", usual=0.0)

  clauses: bool | None = switch("attention of each part of a motion to the clause of the prompt that is due, for "
                                "prompts such as \"walks, then sits down\"; else to the whole prompt", usual=False)

  def resolved(self, config: "ConfigDict", **usual: Any) -> "CmdmSampling":
    learned = "ddpm" if config.model.get("predicts") == "ddpm" else "flow"
    known = SOLVERS[learned]
    options = super().resolved(config, **{"solver": config.sampler.get("solver") or known[0]} | usual)
    if options.solver not in known:
      raise InputError(f"got solver {options.solver!r}, this model knows {', '.join(known)}: it was trained to predict "
                       f"{'the noise of a DDPM' if learned == 'ddpm' else 'a velocity'}")
    return options

  @property
  def steps_apart(self) -> int:
    """Steps between the starts of two blocks: the lag, all steps of "ar", none of "full"."""
    steps: dict[str | None, Any] = {"fss": self.lag, "ar": self.num_steps, "full": 0}
    return steps[self.schedule]

  def about(self) -> dict[str, Any]:
    return super().about() | dict(lag=self.steps_apart)


OPTIONS = CmdmSampling
