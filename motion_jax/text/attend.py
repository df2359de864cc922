"""Multi-head attention of text encoders, between the linear layers that each of them names in its own way."""
import jax
import jax.numpy as jnp

from motion_jax.nets.attention import wide


def attend(query, key, value, num_heads, scale=1.0, attn_mask=None, bias=0.0):
  """softmax(scale * query key^T + bias) value, heads side by side.

  Shapes: query, key, value (B, S, H K); attn_mask (B or 1, 1, S or 1, S) True = may attend; bias (H, S, S) ->
  (B, S, H K).
  """
  heads = lambda x: x.reshape(*x.shape[:2], num_heads, -1)
  dtype = query.dtype
  scores = jnp.einsum("bqhd,bkhd->bhqk", heads(query), heads(key)) * jnp.asarray(scale, dtype)
  scores = scores.astype(wide(dtype)) + bias
  if attn_mask is not None:
    scores = jnp.where(attn_mask, scores, jnp.finfo(scores.dtype).min)
  weights = jax.nn.softmax(scores, axis=-1).astype(dtype)
  return jnp.einsum("bhqk,bkhd->bqhd", weights, heads(value)).reshape(query.shape)
