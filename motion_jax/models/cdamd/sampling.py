"""Motion from CDAMD's generator: in each decoding iteration the diffusion head makes some of the masked latents."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float

from motion_jax.diffusion import ddpm, guidance, ode, samplers
from motion_jax.latents import AutoencoderCodec
from motion_jax.models.cdamd import unmasking
from motion_jax.models.cdamd.guiding import Settling
from motion_jax.nets.masks import LATENT_MASKS, latent_mask
from motion_jax.shapes import Array, Net


class Plan(NamedTuple):
  """The choices that shapes and loops depend on; hashable, so that jit can specialize on it."""
  solver: str = "midpoint"     # of samplers.FIXED_STEP, or "dopri5", or "ddpm"
  num_steps: int = 10          # of the solver; dopri5 chooses its own
  mask: str = "causal"
  guided: bool = True
  num_rows: int | None = None  # unmasking.most_unmasked, or None: solve for every masked latent as the reference does
  ddpm_steps: int = 50         # of training
  temperature: float = 1.0     # of the DDPM's noise; flows have none
  shared_noise: float = 0.0    # of the noise's variance, how much all latents of a motion share; see draws.make_draw


def make_plan(**fields: Any) -> Plan:
  """A Plan; raises ValueError for a solver, mask or number that does not exist."""
  plan = Plan(**fields)
  solvers = (*samplers.FIXED_STEP, "dopri5", "ddpm")
  if plan.solver not in solvers:
    raise ValueError(f"got solver {plan.solver!r}, expected one of {', '.join(solvers)}")
  if plan.mask not in LATENT_MASKS:
    raise ValueError(f"got mask {plan.mask!r}, expected one of {', '.join(LATENT_MASKS)}")
  if plan.num_steps < 1:
    raise ValueError(f"got {plan.num_steps} solver steps, expected at least 1")
  if not 0 <= plan.shared_noise <= 1:
    raise ValueError(f"got {plan.shared_noise} of the noise to share, expected 0 to 1")
  return plan


def make_latents(net: Net, plan: Plan, params: Any, latents: Float[Array, "b l c"], *,
                 text_emb: Float[Array, "b s e"], masked: Bool[Array, "n b l"], real_mask: Bool[Array, "b l"],
                 scale: Any, draw: Callable[..., Array], text_mask: Bool[Array, "b s"] | None = None
                 ) -> Float[Array, "n b l c"]:
  """Latents after each decoding iteration (N, B, L, C), the last the finished ones. Pure; net and plan are static.

  text_emb (B, S, E), text_mask (B, S) or None; latents (B, L, C), of which those are kept that masked (N, B, L) never
  names; real_mask (B, L); scale () of the guidance; draw: see `draws.make_draw`.
  """
  twice = (lambda a: jnp.concatenate([a, a])) if plan.guided else lambda a: a
  words = jnp.concatenate([text_emb, 0 * text_emb]) if plan.guided else text_emb

  def condition(z, masked):
    attn_mask = latent_mask(plan.mask, real_mask & ~masked, real_mask)
    words_mask = None if text_mask is None else twice(text_mask)
    return net.apply(params, twice(z), words, twice(attn_mask), text_mask=words_mask, method="condition")

  def solve(condition, rows, fresh):
    predict = lambda x, t, *_: net.apply(params, x, t, condition, method="predict").astype(latents.dtype)
    predict = guidance.guided(predict, scale) if plan.guided else predict
    noise = fresh(0).astype(latents.dtype)
    if plan.solver == "ddpm":
      schedule = ddpm.respace(ddpm.cosine_schedule(plan.ddpm_steps), min(plan.num_steps, plan.ddpm_steps))
      return ddpm.ancestral(predict, schedule, noise, lambda m: fresh(m + 1).astype(latents.dtype), plan.temperature)
    if plan.solver == "dopri5":
      return ode.dopri5(predict, noise, rows).value
    times = jnp.linspace(0, 1, plan.num_steps + 1, dtype=latents.dtype)[:, None]
    return samplers.FIXED_STEP[plan.solver](predict, noise, times)

  mask_latent = net.apply(params, method="mask_token")
  return unmasking.sample(condition, solve, draw, latents, masked, mask_latent, plan.num_rows)


def generate(net: Net, plan: Plan, params: Any, codec: AutoencoderCodec, *, real_mask: Bool[Array, "b l"],
             settling: Settling | None = None, **given: Any) -> Float[Array, "b t f"]:
  """Normalized features (B, 4 L, F) of new motions; given: masked (N, B, L) of `masking.masked_table`, and what else
  `make_latents` takes. settling pulls finished latents towards constraints. Pure."""
  latents = jnp.zeros(real_mask.shape + (net.transformer.latent_dim,))
  made = make_latents(net, plan, params, latents, real_mask=real_mask, **given)[-1]
  return codec.decode(made if settling is None else settling.settle(codec, made, real_mask), real_mask)
