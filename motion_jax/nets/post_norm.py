"""The transformer layer of 2017, which text encoders, teachers and evaluators of the field still use."""
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

ACTIVATIONS = {
    "gelu": lambda x: jax.nn.gelu(x, approximate=False),
    "gelu_new": lambda x: jax.nn.gelu(x, approximate=True),
    "gelu_pytorch_tanh": lambda x: jax.nn.gelu(x, approximate=True),
    "relu": jax.nn.relu,
}


class PostNormLayer(nn.Module):
  """Self-attention over all real rows, then a feed-forward part; each is added and then normalized.

  BERT's layer, and with eps 1e-5 PyTorch's TransformerEncoderLayer. Shapes: x (B, S, D), key_mask (B, S) True = real,
  or None, bias (H, S, S) or None is added to the scores -> (B, S, D). dropout acts on attention weights, inside the
  feed-forward part and on both branches, where `deterministic` is False; it then draws from the "dropout" rng.
  """
  num_heads: int
  mlp_width: int
  activation: str = "gelu"
  eps: float = 1e-5
  dropout: float = 0.0
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, key_mask=None, deterministic=True, bias=None):
    batch, length, width = x.shape
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, name=name)
    norm = lambda name: nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False, name=name)
    drop = lambda y: nn.Dropout(self.dropout, deterministic=deterministic)(y)
    heads = lambda y: y.reshape(batch, length, self.num_heads, width // self.num_heads)

    query, key, value = (heads(dense(width, name)(x)) for name in ("query", "key", "value"))
    scores = jnp.einsum("bqhd,bkhd->bhqk", query, key) / np.sqrt(width // self.num_heads)
    scores = scores.astype(jnp.promote_types(jnp.float32, scores.dtype))  # softmax in float32 or better
    if bias is not None:
      scores = scores + bias
    if key_mask is not None:
      scores = jnp.where(key_mask[:, None, None, :], scores, jnp.finfo(scores.dtype).min)
    weights = drop(jax.nn.softmax(scores, axis=-1).astype(self.dtype))
    mixed = jnp.einsum("bhqk,bkhd->bqhd", weights, value).reshape(batch, length, width)
    x = norm("attn_norm")(x + drop(dense(width, "out")(mixed)))
    y = drop(ACTIVATIONS[self.activation](dense(self.mlp_width, "mlp_in")(x)))
    return norm("mlp_norm")(x + drop(dense(width, "mlp_out")(y)))


def sinusoids(length, width, dtype=jnp.float32):
  """The fixed positions (length, width): even columns sine, odd columns cosine, base 10000."""
  rate = 10_000.0 ** (-jnp.arange(0, width, 2, dtype=dtype) / width)
  angle = jnp.arange(length, dtype=dtype)[:, None] * rate
  return jnp.stack([jnp.sin(angle), jnp.cos(angle)], axis=-1).reshape(length, -1)[:, :width]
