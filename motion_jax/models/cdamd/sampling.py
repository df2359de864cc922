"""Motion from CDAMD's generator: in each decoding iteration the diffusion head makes some of the masked latents."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion import ddpm, guidance, ode, samplers
from motion_jax.latents import AutoencoderCodec
from motion_jax.models.cdamd import unmasking
from motion_jax.models.cdamd.unmasking import Schedule, State
from motion_jax.nets.masked_transformer import empty_caches
from motion_jax.nets.masks import LATENT_MASKS, latent_mask
from motion_jax.shapes import Array, Bool, Float, Latents, Net


class Plan(NamedTuple):
  """The choices that shapes and loops depend on; hashable, so that jit can specialize on it."""
  solver: str = "midpoint"     # of samplers.METHODS, or "dopri5", or "ddpm"
  num_steps: int = 10          # of the solver; dopri5 chooses its own
  mask: str = "causal"
  guided: bool = True
  num_rows: int | None = None  # of a motion at the head together; None: every masked latent, as the reference does
  ddpm_steps: int = 50         # of training
  temperature: float = 1.0     # of the DDPM's noise; flows have none
  shared_noise: float = 0.0    # of the noise's variance, how much all latents of a motion share; see draws.make_draw
  window: int | None = None    # positions at the transformer together, where the mask is causal; None: all

  def split(self) -> "tuple[Plan, Steps | None]":
    """(a plan that all solvers of fixed steps share, the steps of this one), so that they are one program."""
    if self.solver not in samplers.METHODS:
      return self, None
    return self._replace(solver="steps", num_steps=1), Steps(samplers.METHODS[self.solver], np.int32(self.num_steps))


class Steps(NamedTuple):
  """A method and its number of steps, as arguments of a program."""
  method: samplers.Method
  count: Any


def make_plan(**fields: Any) -> Plan:
  """A Plan; raises ValueError for a solver, mask or number that does not exist."""
  plan = Plan(**fields)
  solvers = (*samplers.METHODS, "dopri5", "ddpm")
  if plan.solver not in solvers:
    raise ValueError(f"got solver {plan.solver!r}, expected one of {', '.join(solvers)}")
  if plan.mask not in LATENT_MASKS:
    raise ValueError(f"got mask {plan.mask!r}, expected one of {', '.join(LATENT_MASKS)}")
  if plan.num_steps < 1:
    raise ValueError(f"got {plan.num_steps} solver steps, expected at least 1")
  if not 0 <= plan.shared_noise <= 1:
    raise ValueError(f"got {plan.shared_noise} of the noise to share, expected 0 to 1")
  if plan.window is not None and plan.mask != "causal":
    raise ValueError(f"got a window with the mask {plan.mask!r}, under which earlier latents see later ones")
  return plan


def start_decoding(net: Net, plan: Plan, params: Any, latents: Float[Array, "b l c"], *,
                   text_emb: Float[Array, "b s e"], schedule: Schedule, real_mask: Bool[Array, "b l"], scale: Any,
                   draw: Callable[..., Array], text_mask: Bool[Array, "b s"] | None = None,
                   steps: Steps | None = None) -> tuple[State, Callable[..., State]]:
  """(the state before the first decoding iteration, step(k, state)); arguments as `make_latents`."""
  steps = steps or plan.split()[1]
  batch, length = latents.shape[:2]
  twice = (lambda a: jnp.concatenate([a, a])) if plan.guided else lambda a: a
  words = jnp.concatenate([text_emb, 0 * text_emb]) if plan.guided else text_emb
  words_mask = None if text_mask is None else twice(text_mask)
  text = net.apply(params, words, method="text_state")

  def condition(z, masked, caches, start):
    attn_mask = twice(latent_mask(plan.mask, real_mask & ~masked, real_mask))
    if plan.window is None:
      return net.apply(params, twice(z), text, attn_mask, words_mask, method="window")[0], caches
    start = twice(start)
    places = start[:, None] + jnp.arange(plan.window)
    attn_mask = jnp.take_along_axis(attn_mask, places[:, None, :, None], axis=2)
    return net.apply(params, twice(z), text, attn_mask, words_mask, caches, start, method="window")

  def solve(condition, rows, fresh):
    noise = fresh(0).astype(latents.dtype)
    if steps is not None:
      prepare = lambda times: net.apply(params, times[:, None, None], condition[None], method="modulation")
      velocity = lambda x, ready: net.apply(params, twice(x), ready, method="run").astype(latents.dtype)

      def combined(x, ready):
        with_text, without = jnp.split(velocity(x, ready), 2)
        return guidance.combine(with_text, without, scale)

      return samplers.runge_kutta(combined if plan.guided else velocity, noise, *steps, prepare)
    predict = lambda x, t, *_: net.apply(params, x, t, condition, method="predict").astype(latents.dtype)
    predict = guidance.guided(predict, scale) if plan.guided else predict
    if plan.solver == "ddpm":
      respaced = ddpm.respace(ddpm.cosine_schedule(plan.ddpm_steps), min(plan.num_steps, plan.ddpm_steps))
      return ddpm.ancestral(predict, respaced, noise, lambda m: fresh(m + 1).astype(latents.dtype), plan.temperature)
    return ode.dopri5(predict, noise, rows).value

  mask_latent = net.apply(params, method="mask_token")
  caches = () if plan.window is None else empty_caches(net.transformer, len(words), length)
  step = unmasking.decoding_step(condition, solve, draw, schedule, mask_latent, plan.num_rows, plan.window)
  return State(latents, caches), step


def make_latents(net: Net, plan: Plan, params: Any, latents: Latents, *, schedule: Schedule,
                 **given: Any) -> Latents:
  """Latents (B, L, C) with those sampled that the schedule names; the others are kept to the bit. Pure.

  net and plan are static. given: text_emb (B, S, E), text_mask (B, S) or None; real_mask (B, L); scale () of the
  guidance; draw: see `draws.make_draw`; steps: instead of the plan's solver and num_steps.
  """
  state, step = start_decoding(net, plan, params, latents, schedule=schedule, **given)
  count = schedule.num_iterations
  return jax.lax.fori_loop(0, count if isinstance(count, jax.Array) else int(count), step, state).latents


def generate(net: Net, plan: Plan, params: Any, codec: AutoencoderCodec, *, real_mask: Bool[Array, "b l"],
             **given: Any) -> Float[Array, "b t f"]:
  """Normalized features (B, 4 L, F) of new motions; given: what `make_latents` takes. Pure."""
  latents = jnp.zeros(real_mask.shape + (net.transformer.latent_dim,))
  return codec.decode(make_latents(net, plan, params, latents, real_mask=real_mask, **given), real_mask)
