"""Diffusion forcing in a DDPM: each latent has its own of 1,000 noise levels, and steps draw fresh noise.

CMDM's paper, equations 7 to 11 and algorithms 1 and 2; the released code, and our default, are `paths` and `samplers`.
A level k counts noise, 0 = clean. Outside of this file it is the time t = 1 - k / K, 0 = noise, 1 = clean, so that one
table of times says when which latent is cleaned, whatever the noise. The paper names no schedule of variances; ours is
that of the DDPM that it cites.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion import ddpm
from motion_jax.shapes import Array, Bool, Float, Int, Latents

NUM_LEVELS = 1_000
SOLVERS = ("ancestral", "ddim")


def linear_schedule(num_levels: int = NUM_LEVELS, first: float = 1e-4, last: float = 0.02) -> ddpm.Schedule:
  """Variances that rise in a straight line (Ho et al., "Denoising Diffusion Probabilistic Models", section 4)."""
  return ddpm.schedule_of(np.linspace(first, last, num_levels))


def kept_shares(num_levels: int = NUM_LEVELS) -> Float[np.ndarray, " {num_levels}+1"]:
  """(K + 1,) float64: the share of the data's variance that is left at level k, 1 at level 0."""
  return np.append(1.0, linear_schedule(num_levels).alphas_cumprod)


def level_of(t: Float[Array, "*lead"]) -> Int[Array, "*lead"]:
  """Levels 0..K of times t, integers."""
  return jnp.round((1 - t) * NUM_LEVELS).astype(int)


def forcing_times(rng: jax.Array, batch: int, length: int, block: int) -> Float[Array, "{batch} {length}"]:
  """t (B, L) of levels drawn from {0, 1, ..., K}, one draw per block of latents; block 0: one for the sequence."""
  block = block or length
  level = jax.random.randint(rng, (batch, -(-length // block)), 0, NUM_LEVELS + 1)
  return jnp.repeat(1 - level / NUM_LEVELS, block, axis=1)[:, :length]


def add_noise(x1: Float[Array, "*lead c"], noise: Float[Array, "*lead c"], t: Float[Array, "*#lead"]
              ) -> Float[Array, "*lead c"]:
  """Data x1 (..., C) as it is at times t (...): sqrt(kept) x1 + sqrt(1 - kept) noise."""
  kept, level = kept_shares(), level_of(t)
  of_data, of_noise = (jnp.asarray(np.sqrt(share), x1.dtype)[level][..., None] for share in (kept, 1 - kept))
  return of_data * x1 + of_noise * noise


def forcing_loss(noise_at: Callable[..., Any], x1: Latents, latent_mask: Bool[Array, "b l"],
                 t: Float[Array, "b l"], noise: Latents) -> tuple[dict[str, Array], Array]:
  """Squared error of the predicted noise over real latents, as (sums, weight), both as in `paths.forcing_loss`.

  noise_at(x, t) -> (B, L, C). At level 0 there is no noise to be seen, which algorithm 1 draws like the others.
  """
  error = (noise_at(add_noise(x1, noise, t), t) - noise) ** 2
  error = error.astype(jnp.promote_types(x1.dtype, jnp.float32)).mean(-1)
  return {"loss": jnp.where(latent_mask, error, 0.0).sum()}, latent_mask.sum()


class Steps(NamedTuple):
  """How to go from each of N + 1 levels to the next cleaner one: times (N + 1,), and of step m the factors (N,) of the
  latent, of the noise that is predicted in it, and of fresh noise."""
  times: jax.Array
  of_x: jax.Array
  of_predicted: jax.Array
  of_fresh: jax.Array


def make_steps(num_steps: int, solver: str = "ancestral") -> Steps:
  """num_steps of the K levels, evenly spread, from K to 0.

  "ancestral": x' = (x - (1 - a) / sqrt(1 - kept) noise) / sqrt(a) + s w with a = kept / kept', algorithm 2; s^2 is the
  variance (1 - kept') / (1 - kept) (1 - a) that x' has once x and the data are known, 0 at the end. "ddim": the same
  guess of the data, noised with the predicted noise again instead of fresh, an Euler step of the DDPM's ODE.
  """
  if not 1 <= num_steps <= NUM_LEVELS:
    raise ValueError(f"got {num_steps} sampler steps, expected 1 to the {NUM_LEVELS} levels of training")
  levels = np.round(np.linspace(NUM_LEVELS, 0, num_steps + 1)).astype(int)
  kept = kept_shares()[levels]
  kept, after = kept[:-1], kept[1:]
  a = kept / after
  if solver == "ancestral":
    of_predicted = -(1 - a) / np.sqrt(1 - kept) / np.sqrt(a)
    of_fresh = np.sqrt((1 - after) / (1 - kept) * (1 - a))
  else:
    of_predicted, of_fresh = np.sqrt(1 - after) - np.sqrt((1 - kept) / a), np.zeros(num_steps)
  return Steps(*(jnp.asarray(table, jnp.float32) for table in (
      1 - levels / NUM_LEVELS, 1 / np.sqrt(a), of_predicted, of_fresh)))


def step(steps: Steps, x: Latents, predicted: Latents, now: Int[Array, " l"],
         then: Int[Array, " l"], fresh: Latents | float) -> Latents:
  """Latents x (B, L, C) from step now to then (L,), integers 0..N; where both are the same, they stay."""
  row = jnp.minimum(now, len(steps.of_x) - 1)
  of_x, of_predicted, of_fresh = (table[row][:, None].astype(x.dtype) for table in steps[1:])
  return jnp.where((then > now)[:, None], of_x * x + of_predicted * predicted + of_fresh * fresh, x)


def sample(noise_at: Callable[..., Array], x: Float[Array, "b l c"], levels: Int[Array, "m l"], steps: Steps,
           fresh: Callable[[Array], Array]) -> Any:
  """Carries noise x (B, L, C) to data along a table of steps (M + 1, L), `schedules.staircase_levels`.

  noise_at(x, t (L,)) -> (B, L, C); fresh(now (L,)) -> the fresh noise of each latent's step, (B, L, C).
  """
  def body(x, interval):
    now, then = interval
    return step(steps, x, noise_at(x, steps.times[now]), now, then, fresh(now)), None

  levels = jnp.asarray(levels)
  return jax.lax.scan(body, x, (levels[:-1], levels[1:]))[0]
