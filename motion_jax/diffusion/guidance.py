"""Classifier-free guidance: away from what the model does without words, towards what it does with them."""
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Float, Num

from motion_jax.shapes import Array

Scale = float | Num[Array, "..."]


def combine(with_text: Float[Array, "*dims"], without: Float[Array, "*dims"], scale: Scale) -> Float[Array, "*dims"]:
  """without + scale (with_text - without); scale 1 is the model itself, 0 ignores the words.

  Source: docs/papers/cmdm.md#guidance, docs/papers/cdamd.md#guidance.
  """
  return without + scale * (with_text - without)


def guided(velocity: Callable, scale: Scale) -> Callable:
  """Wraps velocity(x, t, drop (B,)) -> (B, L, C) into one of (x, t), both branches in one batch of 2 B."""

  def both(x, t):
    batch = x.shape[0]
    drop = jnp.arange(2 * batch) >= batch
    with_text, without = jnp.split(velocity(jnp.concatenate([x, x]), t, drop), 2)
    return combine(with_text, without, scale)

  return both
