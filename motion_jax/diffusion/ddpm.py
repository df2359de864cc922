"""Diffusion in discrete steps, noise predicted, as MARDM's DDPM variant does it (docs/papers/cdamd.md#diffusion-mlp).

Steps count upwards in noise, 0 being the cleanest, the other way round than the times elsewhere in this package: they
are indices of the tables below, and what enters the network.
"""
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from motion_jax.shapes import Array

Table = Float[np.ndarray, " n"]

class Schedule(NamedTuple):
  """Tables (N,) in float64: the variance that each step adds, what is left of the data, and how to go one step back.

  `steps` are the steps of the training schedule that these correspond to; the network gets those.
  """
  steps: Int[np.ndarray, " n"]
  betas: Table
  alphas_cumprod: Table
  sqrt_recip_alphas_cumprod: Table
  sqrt_recipm1_alphas_cumprod: Table
  posterior_variance: Table
  posterior_log_variance_clipped: Table
  posterior_mean_coef1: Table
  posterior_mean_coef2: Table


def schedule_of(betas: Table, steps: Int[np.ndarray, " n"] | None = None) -> Schedule:
  """All tables from the variances betas (N,)."""
  betas = np.asarray(betas, np.float64)
  kept = np.cumprod(1 - betas)
  before = np.append(1.0, kept[:-1])
  variance = betas * (1 - before) / (1 - kept)
  # The last step back has variance 0, whose logarithm is replaced by its neighbour's.
  log_variance = np.log(np.append(variance[1], variance[1:])) if len(betas) > 1 else np.zeros(1)
  return Schedule(np.arange(len(betas)) if steps is None else np.asarray(steps), betas, kept, np.sqrt(1 / kept),
                  np.sqrt(1 / kept - 1), variance, log_variance, betas * np.sqrt(before) / (1 - kept),
                  (1 - before) * np.sqrt(1 - betas) / (1 - kept))


def cosine_schedule(num_steps: int = 50) -> Schedule:
  """The squared-cosine schedule, its variances capped at 0.999."""
  # Parity: 50 steps in training too, where most use 1000.
  left = lambda s: np.cos((s + 0.008) / 1.008 * np.pi / 2) ** 2
  index = np.arange(num_steps)
  return schedule_of(np.minimum(1 - left((index + 1) / num_steps) / left(index / num_steps), 0.999))


def respace(schedule: Schedule, num_steps: int) -> Schedule:
  """A schedule of num_steps of the given one's steps, evenly spread, its first and last among them."""
  total = len(schedule.betas)
  if not 1 <= num_steps <= total:
    raise ValueError(f"got {num_steps} sampler steps, expected 1 to the {total} of training")
  chosen = np.round(np.linspace(0, total - 1, num_steps)).astype(int) if num_steps > 1 else np.array([0])
  kept = schedule.alphas_cumprod[chosen]
  return schedule_of(1 - kept / np.append(1.0, kept[:-1]), schedule.steps[chosen])


def add_noise(schedule: Schedule, x1: Float[Array, "*lead c"], noise: Float[Array, "*lead c"],
              step: Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """Data x1 (..., C) as it is after `step` (...)."""
  kept = schedule.alphas_cumprod
  of_data, of_noise = (jnp.asarray(np.sqrt(a), x1.dtype)[step][..., None] for a in (kept, 1 - kept))
  return of_data * x1 + of_noise * noise


def loss_rows(predict: Callable, schedule: Schedule, x1: Float[Array, "*lead c"], step: Int[Array, "*lead"],
              noise: Float[Array, "*lead c"]) -> Float[Array, "*lead"]:
  """Squared error of the predicted noise, averaged over channels: (...) for x1 (..., C), step (...)."""
  predicted = predict(add_noise(schedule, x1, noise, step), jnp.asarray(schedule.steps)[step])
  return ((predicted - noise) ** 2).mean(-1)


def step_back(schedule: Schedule, x: Float[Array, "*lead c"], predicted: Float[Array, "*lead c"],
              index: int | Int[Array, ""], noise: Float[Array, "*lead c"], temperature: float = 1.0
              ) -> Float[Array, "*lead c"]:
  """One ancestral step from table row `index` () to the one before, given the predicted noise; row 0 adds none."""
  row = lambda table: jnp.asarray(table, x.dtype)[index]
  x1 = row(schedule.sqrt_recip_alphas_cumprod) * x - row(schedule.sqrt_recipm1_alphas_cumprod) * predicted
  mean = row(schedule.posterior_mean_coef1) * x1 + row(schedule.posterior_mean_coef2) * x
  std = jnp.exp(0.5 * row(schedule.posterior_log_variance_clipped))
  return mean + jnp.where(index > 0, std * temperature, 0.0) * noise


def ancestral(predict: Callable, schedule: Schedule, x: Float[Array, "*lead c"], fresh: Callable,
              temperature: float = 1.0) -> Float[Array, "*lead c"]:
  """Carries noise x (..., C) to data; predict(x, step ()) -> noise (..., C); fresh(m) is the noise of the m-th step
  back, m a traced integer from 0."""
  last = len(schedule.betas) - 1

  def back(x, m):
    predicted = predict(x, jnp.asarray(schedule.steps)[last - m])
    return step_back(schedule, x, predicted, last - m, fresh(m), temperature), None

  return jax.lax.scan(back, x, jnp.arange(last + 1))[0]
