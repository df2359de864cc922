"""Latents, or frames without a VAE, from captions with MLD."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion import ddpm, guidance
from motion_jax.shapes import Array, Float, Net


class FrameDenoiser(NamedTuple):
  """A denoiser of frames with the interface of a denoiser of latents. Its prediction is 0 at padding, which, if hidden,
  is not attended to.

  real (B, T): real frames; a batch of 2 B rows is two such batches.
  """
  net: Net
  real: Any
  hidden: bool = True

  def apply(self, params: Any, x: Float[Array, "b t f"], t: Any, text: Float[Array, "b s e"], **more: Any
            ) -> Float[Array, "b t f"]:
    real = jnp.concatenate([self.real] * (len(x) // len(self.real)))
    prediction = self.net.apply(params, x, t, text, frame_mask=real if self.hidden else None, **more)
    return jnp.where(real[..., None], prediction, 0)


class Plan(NamedTuple):
  """Static choices of sampling; hashable. predicts: what the denoiser learned, "noise" or "x1"."""
  train_steps: int = 1000
  num_steps: int = 50
  solver: str = "ddim"  # or "ancestral"
  predicts: str = "noise"
  guided: bool = True


def ddim_steps(train_steps: int, num_steps: int) -> np.ndarray:
  """Steps of a sampler at a whole stride, rising from 1 (docs/papers/mld.md#sampling)."""
  return np.arange(num_steps) * (train_steps // num_steps) + 1


def schedule_of(plan: Plan) -> ddpm.Schedule:
  """The steps that the plan makes of the whole schedule."""
  whole = ddpm.scaled_linear_schedule(plan.train_steps)
  if plan.solver == "ddim":
    return ddpm.at_steps(whole, np.minimum(ddim_steps(plan.train_steps, plan.num_steps), plan.train_steps - 1))
  return ddpm.at_steps(whole, np.arange(plan.num_steps) * (plan.train_steps // plan.num_steps))


def predictor(net: Net, plan: Plan, params: Any, text_emb: Float[Array, "b s e"], no_text_emb: Float[Array, "b s e"],
              scale: Any) -> Callable:
  """predict(z, step ()) -> noise or clean latents, guided; no_text_emb: the embedding of an empty caption."""
  text = jnp.concatenate([text_emb, no_text_emb]) if plan.guided else text_emb
  return guidance.two_branches(lambda z, step: net.apply(params, z, step, text), plan.guided, scale)


def denoise(net: Net, plan: Plan, params: Any, text_emb: Float[Array, "b s e"], no_text_emb: Float[Array, "b s e"],
            scale: Any, draw: Callable) -> Float[Array, "b n d"]:
  """Latents (B, N, D); draw(0) is the noise to begin with, draw(m) that of the m-th step, if the solver takes any."""
  predict = predictor(net, plan, params, text_emb, no_text_emb, scale)
  schedule = schedule_of(plan)
  if plan.solver == "ddim":
    # Parity: the last step of the reference goes to the schedule's first level of noise, not to none.
    end = float(ddpm.scaled_linear_schedule(plan.train_steps).alphas_cumprod[0])
    return ddpm.ddim(predict, schedule, draw(0), end, plan.predicts)
  return ddpm.ancestral(predict, schedule, draw(0), lambda m: draw(m + 1), predicts=plan.predicts)
