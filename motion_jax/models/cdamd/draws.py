"""The random numbers of CDAMD, as functions of keys: of a training step, and of making motion.

An item's numbers depend on its own key alone, so they are the same in any batch and on any number of devices.
"""
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from motion_jax.models.shared import mask_schedule as masking
from motion_jax.shapes import Array, Float


class Draws(NamedTuple):
  """Random numbers of a training step for B motions of L latents, each with M rows at the diffusion head.

  From [0, 1): time_u, text_u, prior_u, mask_u (B,); order_u, noise_u, keep_u (B, L); t (M, B, L), for DDPM integers.
  Normal: noise (B, L, C), diffusion_noise (M, B, L, C).
  """
  time_u: jax.Array
  text_u: jax.Array
  prior_u: jax.Array
  order_u: jax.Array
  noise_u: jax.Array
  keep_u: jax.Array
  t: jax.Array
  noise: jax.Array
  diffusion_noise: jax.Array
  mask_u: jax.Array | None = None  # only where several masks are trained


def draw_step(rng: jax.Array, keys: jax.Array, length: int, channels: int, config: ConfigDict) -> Draws:
  """keys (B,): one per item, so that draws are the same on any number of devices; rng: the same on all of them."""
  copies = config.copies

  def of_item(key):
    time, text, prior, places, t, noise, mask = jax.random.split(key, 7)
    normal = jax.random.normal(noise, (1 + copies, length, channels))
    if config.diffusion == "ddpm":
      t = jax.random.randint(t, (copies, length), 0, config.ddpm_steps)
    else:
      t = jax.random.uniform(t, (copies, length))
    uniform = lambda key: jax.random.uniform(key)
    order, noised, kept = jax.random.uniform(places, (3, length))
    return Draws(uniform(time), uniform(text), uniform(prior), order, noised, kept, t, normal[0], normal[1:],
                 uniform(mask))

  axes: Any = (0, 0, 0, 0, 0, 0, 1, 0, 1, 0)
  draws = jax.vmap(of_item, out_axes=Draws(*axes))(keys)
  if config.prior_drop == "batch":  # Parity: one draw for all; "item" is the option
    draws = draws._replace(prior_u=jnp.broadcast_to(jax.random.uniform(rng), draws.prior_u.shape))
  return draws


_SHARED = 1 << 30  # stands for the iteration in the noise that all latents share


def make_draw(keys: jax.Array, channels: int, shared: float = 0.0) -> Callable[..., Array]:
  """draw(k, j, places) for `make_latents`: noise (B, R, C) of places (B, R) in iterations k (B, R), which depends on a
  motion's key, iteration, step j and place, nothing else, so neither padding nor batch-mates change it. keys (B,).

  shared: share of the noise variance that all latents of a motion have in common. With independent noise the head
  decides what the transformer leaves open, such as the exact position of the body, separately for every latent, and the
  body shakes; with common noise neighbours decide alike. Each latent's noise is a standard normal for any share, as in
  training; the reference shares none.
  """
  fold = jax.random.fold_in

  def draw(k, j, places):
    of_place = lambda key, k, place: jax.random.normal(fold(fold(fold(key, k), j), place), (channels,))
    independent = jax.vmap(jax.vmap(of_place, (None, 0, 0)))(keys, k, places)
    if not shared:
      return independent
    common = jax.vmap(lambda key: jax.random.normal(fold(fold(key, _SHARED), j), (1, channels)))(keys)
    return jnp.sqrt(shared) * common + jnp.sqrt(1 - shared) * independent

  return draw


def draw_order(keys: jax.Array, lengths: Sequence[int] | Array, length: int, order: str = "random"
               ) -> Float[np.ndarray, "b {length}"]:
  """(B, L) numpy: in which order latents are made, last ones smallest; infinity at padding. keys (B,), lengths (B,)."""
  # Parity: the paper fills from left to right; the code, and our default, at random.
  if order == "left_to_right":
    numbers: Any = np.broadcast_to(masking.left_to_right(length), (len(lengths), length))
  elif order == "random":
    numbers = _random_order(keys, length)
  else:
    raise ValueError(f"got order {order!r}, expected random or left_to_right")
  return np.where(np.arange(length) < np.asarray(lengths)[:, None], numbers, np.inf)


@functools.partial(jax.jit, static_argnums=1)
def _random_order(keys, length):
  of_place = lambda key, place: jax.random.uniform(jax.random.fold_in(jax.random.fold_in(key, 2**31 - 1), place))
  return jax.vmap(lambda key: jax.vmap(lambda place: of_place(key, place))(jnp.arange(length)))(keys)
