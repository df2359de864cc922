"""Classifier-free guidance: away from what the model does without words, towards what it does with them."""
import jax.numpy as jnp


def combine(with_text, without, scale):
  """without + scale (with_text - without); scale 1 is the model itself, 0 ignores the words.

  Source: docs/papers/cmdm.md#guidance, docs/papers/cdamd.md#guidance.
  """
  return without + scale * (with_text - without)


def guided(velocity, scale):
  """Wraps velocity(x, t, drop (B,)) -> (B, L, C) into one of (x, t), both branches in one batch of 2 B."""

  def both(x, t):
    batch = x.shape[0]
    drop = jnp.arange(2 * batch) >= batch
    return combine(*jnp.split(velocity(jnp.concatenate([x, x]), t, drop), 2), scale)

  return both
