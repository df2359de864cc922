"""The straight path from noise (t = 0) to data (t = 1), conversions of predictions along it, and the forcing loss.

x_t = t x1 + (1 - t) eps, velocity v = x1 - eps (docs/papers/cmdm.md#denoiser-loss).
Times t (B, L) go with arrays (B, L, C).
"""
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from motion_jax import shapes
from motion_jax.shapes import Array, Bool, Float, Int, Key


def add_noise(x1: Float[Array, "*#lead c"], noise: Float[Array, "*#lead c"], t: Float[Array, "*#lead"]
              ) -> Float[Array, "*all c"]:
  t = t[..., None]
  return t * x1 + (1 - t) * noise


def velocity_to_x1(x: Float[Array, "*lead c"], velocity: Float[Array, "*lead c"], t: Float[Array, "*#lead"]
                   ) -> Float[Array, "*lead c"]:
  """The clean sample (t = 1) of the path through x at time t, given the velocity."""
  return x + (1 - t[..., None]) * velocity


def velocity_to_noise(x: Float[Array, "*lead c"], velocity: Float[Array, "*lead c"], t: Float[Array, "*#lead"]
                      ) -> Float[Array, "*lead c"]:
  """The noise (t = 0) of the path through x at time t, given the velocity."""
  return x - t[..., None] * velocity


def forcing_times(rng: Key[Array, ""], batch: int, length: int, block: int) -> Float[Array, "{batch} {length}"]:
  """Diffusion forcing: t (B, L) uniform in [0, 1), one draw per block of latents, independent of its neighbours.

  block = 0 draws one time for the whole sequence (ordinary diffusion). The last block may be shorter.
  """
  block = block or length
  draws = jax.random.uniform(rng, (batch, -(-length // block)))
  return jnp.repeat(draws, block, axis=1)[:, :length]


def ramp_times(rng: Key[Array, ""], length: int, block: int, widest: int = 16, real: Int[Array, ""] | None = None
               ) -> Float[Array, " {length}"]:
  """t (L,) as frame-wise sampling has them at some moment: 1 for blocks that are finished, 0 for those to come, and in
  between a slope over 1 to `widest` blocks, all widths of a doubling as likely. real: how many latents there are, of
  which the moment is one; all of length, if left out."""
  block = block or length
  blocks = -(-length // block)
  width_rng, place_rng = jax.random.split(rng)
  width = jnp.exp(jax.random.uniform(width_rng, maxval=jnp.log(float(widest))))
  place = jax.random.uniform(place_rng) * (width + (blocks if real is None else -(-real // block)))
  return jnp.repeat(jnp.clip((place - jnp.arange(blocks)) / width, 0.0, 1.0), block)[:length]


# Conversions from a velocity to the quantity whose error is the loss; names as in `CausalDiT.predicts`.
TARGETS = {"velocity": lambda x, velocity, t: velocity, "eps": velocity_to_noise, "x1": velocity_to_x1}


class Contrast(NamedTuple):
  """A term of `forcing_loss` that asks for a larger error under other clips' conditions than under the true ones.

  velocity(x, t) -> (B, L, C) with those conditions; counts (B, L): the latents whose mean errors are compared, none for
  a clip that kept its condition; weight of the term, and the margin of `margin_loss`.
  """
  velocity: Callable
  counts: Bool[Array, "b l"]
  weight: float
  margin: float


def margin_loss(error: Float[Array, "*b"], other: Float[Array, "*b"], margin: float) -> Float[Array, "*b"]:
  """Hinge loss: max(0, error with the true condition + margin - error with another one)."""
  return jnp.maximum(margin + error - other, 0.0)


def forcing_loss(velocity: Callable, x1: Float[Array, "b l c"], latent_mask: Bool[Array, "b l"],
                 t: Float[Array, "b l"], noise: Float[Array, "b l c"], target: str = "velocity",
                 errors_of: Callable | None = None, contrast: Contrast | None = None
                 ) -> tuple[dict[str, Float[Array, ""]], Int[Array, ""]]:
  """Mean squared error of the target over real latents, as (sums, weight) to be added up over devices.

  velocity(x, t) -> (B, L, C); x1, noise (B, L, C); latent_mask, t (B, L). target is one of TARGETS: the error of the
  velocity, or of the noise (eps) or clean latents (x1) it implies, which weights times differently. sums["loss"] is
  summed over real latents, averaged over channels; weight is the number of real latents.

  errors_of(clean (B, L, C)) -> {name: (B,)}: further terms, of the clean latents that the velocity implies. Each is
  reported by its name and added to the loss, a clip weighted by its number of real latents. contrast: a further term
  from conditions of other clips, see `Contrast`.
  """
  # Parity: the paper's equations learn the noise of a DDPM schedule; the code, and we, the velocity of this path.
  shapes.check(x1=(x1, "BLC"), noise=(noise, "BLC"), latent_mask=(latent_mask, "BL"), t=(t, "BL"))
  x = add_noise(x1, noise, t)
  in_space = TARGETS[target]
  predicted = velocity(x, t)

  def error_of(predicted):
    difference = in_space(x, predicted, t) - in_space(x, x1 - noise, t)
    return (difference ** 2).astype(jnp.promote_types(x1.dtype, jnp.float32)).mean(-1)

  error = error_of(predicted)
  sums: dict[str, Array] = {"loss": jnp.where(latent_mask, error, 0.0).sum()}
  terms = dict(errors_of(velocity_to_x1(x, predicted, t))) if errors_of else {}
  if contrast is not None:
    mean = lambda error: jnp.where(contrast.counts, error, 0.0).sum(1) / jnp.maximum(contrast.counts.sum(1), 1)
    terms["contrast"] = contrast.weight * jnp.where(
        contrast.counts.any(1), margin_loss(mean(error), mean(error_of(contrast.velocity(x, t))), contrast.margin), 0.0)
  for name, errors in terms.items():
    sums[name] = (errors * latent_mask.sum(1)).sum().astype(sums["loss"].dtype)
    sums["loss"] += sums[name]
  return sums, latent_mask.sum()
