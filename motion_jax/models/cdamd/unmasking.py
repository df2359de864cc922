"""Sampling by unmasking: in each decoding iteration masked latents are made, and all but a few of them masked again,
until none is left.

The tables of `mask_schedule` say which latents each iteration finds masked. What an iteration makes of a latent that
the next one hides again is lost, so it suffices to solve for the others: the same motion from the same noise, as a
solver with fixed steps treats every row alone, at a sixth of the cost.
"""
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from motion_jax.models import mask_schedule as masking
from motion_jax.shapes import Array


def most_unmasked(counts: Int[Array, "n b"]) -> int:
  """The most latents that one iteration of counts (N, B) unmasks in one motion: rows that its solver needs."""
  return int(-np.diff(counts, axis=0, append=0).min())


def sample(condition: Callable[..., Array], solve: Callable[..., Array], draw: Callable[..., Array],
           latents: Float[Array, "b l c"], masked: Bool[Array, "n b l"], mask_latent: Float[Array, "1 1 c"],
           num_rows: int | None = None) -> Float[Array, "n b l c"]:
  """Latents after each decoding iteration (N, B, L, C), the last ones those of the motion.

  condition(z (B, L, C), masked (B, L)) -> (G B, L, H), G branches of guidance one after the other. solve(condition
  (G B, R, H), rows (B, R), fresh) -> (B, R, C), where fresh(j) is the j-th noise (B, R, C) that it needs and rows say
  which of its results are wanted. draw(k, j) -> that noise (B, L, C) for all latents in iteration k. Both integers may
  be traced. latents (B, L, C): what is never masked stays as it is there, to the bit. masked (N, B, L). num_rows, see
  `most_unmasked`: solve only for the latents that the iteration unmasks; None solves for all that are masked, as the
  reference does.
  """
  num_iterations, batch, length = masked.shape
  wanted = masked if num_rows is None else masking.unmasked_table(masked)
  row = jnp.arange(batch)[:, None]

  def make(z, k, masked, wanted):
    z = jnp.where(masked[..., None], mask_latent.astype(z.dtype), z)
    # The wanted places first, in order; of a motion with fewer of them others follow, whose results are dropped.
    places = jnp.argsort(~wanted, axis=-1, stable=True)[:, :num_rows] if num_rows is not None else (
        jnp.broadcast_to(jnp.arange(length), (batch, length)))
    rows = wanted[row, places]
    conditions = condition(z, masked)
    branches = conditions.shape[0] // batch
    conditions = jnp.take_along_axis(conditions, jnp.tile(places, (branches, 1))[..., None], axis=1)
    made = solve(conditions, rows, lambda j: draw(k, j)[row, places]).astype(z.dtype)
    return z.at[row, places].set(jnp.where(rows[..., None], made, z[row, places]))

  def iteration(z, given):
    k, masked, wanted = given
    z = jax.lax.cond(wanted.any(), make, lambda z, *_: z, z, k, masked, wanted)
    return z, z

  return jax.lax.scan(iteration, latents, (jnp.arange(num_iterations), jnp.asarray(masked), jnp.asarray(wanted)))[1]
