"""Classifier-free guidance: extrapolation from the prediction without a caption to that with it."""
from collections.abc import Callable

import jax.numpy as jnp

from motion_jax.shapes import Array, Float, Num

Scale = float | Num[Array, "..."]


def combine(with_text: Float[Array, "*dims"], without: Float[Array, "*dims"], scale: Scale) -> Float[Array, "*dims"]:
  """without + scale (with_text - without); scale 1 is the prediction with text, 0 that without.

  Source: docs/papers/cmdm.md#guidance, docs/papers/cdamd.md#guidance.
  """
  return without + scale * (with_text - without)


def guided(velocity: Callable, scale: Scale) -> Callable:
  """Wraps velocity(x, t, drop (B,)) -> (B, L, C) into a guided one of (x, t), which runs both in a batch of 2 B."""

  def both(x, t):
    batch = x.shape[0]
    drop = jnp.arange(2 * batch) >= batch
    with_text, without = jnp.split(velocity(jnp.concatenate([x, x]), t, drop), 2)
    return combine(with_text, without, scale)

  return both


def two_branches(predict: Callable, is_guided: bool, scale: Scale) -> Callable:
  """Wraps predict(x (2 B, ...), t (2 B,)), whose conditions are B with captions and B without, into a guided function
  of (x (B, ...), t ()). scale: () or (B,). Without guidance predict has B conditions, and nothing is combined."""

  def guided_prediction(x, t):
    rows = jnp.concatenate([x, x]) if is_guided else x
    prediction = predict(rows, jnp.broadcast_to(t, len(rows)))
    if not is_guided:
      return prediction
    with_text, without = jnp.split(prediction, 2)
    weight = jnp.asarray(scale, prediction.dtype)
    return combine(with_text, without, weight.reshape(weight.shape + (1,) * (x.ndim - 1) * bool(weight.ndim)))

  return guided_prediction
