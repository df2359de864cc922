"""Attention with normalized queries and keys and rotary positions, in pieces that a key-value cache can use."""
import math
from collections.abc import Callable
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp


def wide(dtype):
  """The type in which norms, angles and softmax are computed: float32 at least."""
  return jnp.promote_types(dtype, jnp.float32)


class RMSNorm(nn.Module):
  """x / sqrt(mean(x^2) + eps) * scale over the last axis."""
  eps: float = 1e-6
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x):
    scale = self.param("scale", nn.initializers.ones, (x.shape[-1],))
    y = x.astype(wide(self.dtype))
    y = y * jax.lax.rsqrt((y * y).mean(-1, keepdims=True) + self.eps)
    return (y * scale).astype(self.dtype)


def rotary(x, positions, base=10_000.0):
  """Turns adjacent pairs of channels by position * base^(-2 i / K): x (..., L, H, K), positions (L,) or (..., L).

  Scores then depend on differences of positions only, so positions may be shifted all together.
  """
  half = x.shape[-1] // 2
  angles = positions[..., None].astype(wide(x.dtype)) * base ** (-jnp.arange(half, dtype=wide(x.dtype)) / half)
  cos, sin = (f(angles)[..., None, :] for f in (jnp.cos, jnp.sin))
  even, odd = x[..., 0::2], x[..., 1::2]
  turned = jnp.stack([even * cos - odd * sin, even * sin + odd * cos], axis=-1)
  return turned.reshape(x.shape).astype(x.dtype)


class Attention(nn.Module):
  """Multi-head attention in three steps: `queries`, `keys_values`, `attend`.

  Queries and keys are RMS-normalized over the whole width before the heads are split (docs/papers/cmdm.md#causal-dit);
  not so with normalize=False. `rotary` turns them between the steps, so that a cache can hold keys that are not tied to
  a position yet. dropout acts on the weights where `deterministic` is False, from the "dropout" rng.
  Shapes: x (B, L, D); q, k, v (B, L, H, D / H); attn_mask (B or 1, 1, L, S).
  """
  width: int
  num_heads: int
  dtype: Any = jnp.float32
  normalize: bool = True
  dropout: float = 0.0
  kernel_init: Callable = nn.initializers.xavier_uniform()

  def setup(self):
    if self.width % self.num_heads:
      raise ValueError(f"got width {self.width} for {self.num_heads} heads, expected a multiple")
    dense = lambda: nn.Dense(self.width, kernel_init=self.kernel_init, dtype=self.dtype)
    self.q, self.k, self.v, self.o = dense(), dense(), dense(), dense()
    norm = lambda: RMSNorm(dtype=self.dtype) if self.normalize else lambda x: x
    self.norm_q, self.norm_k = norm(), norm()
    self.drop = nn.Dropout(self.dropout)

  def _heads(self, x):
    return x.reshape(x.shape[:-1] + (self.num_heads, self.width // self.num_heads))

  def queries(self, x):
    return self._heads(self.norm_q(self.q(x)))

  def keys_values(self, x):
    return self._heads(self.norm_k(self.k(x))), self._heads(self.v(x))

  def attend(self, q, k, v, attn_mask=None, deterministic=True):
    scores = jnp.einsum("bqhd,bkhd->bhqk", q, k, preferred_element_type=wide(self.dtype))
    scores = scores / math.sqrt(q.shape[-1])
    if attn_mask is not None:
      scores = jnp.where(attn_mask, scores, jnp.finfo(scores.dtype).min)
    weights = self.drop(jax.nn.softmax(scores, axis=-1).astype(self.dtype), deterministic=deterministic)
    y = jnp.einsum("bhqk,bkhd->bqhd", weights, v)
    return self.o(y.reshape(y.shape[:-2] + (self.width,)))

  def __call__(self, x, context=None, attn_mask=None, positions=None, deterministic=True):
    """Self-attention, or cross-attention to a context (B, S, D)."""
    q, (k, v) = self.queries(x), self.keys_values(x if context is None else context)
    if positions is not None:
      q, k = rotary(q, positions), rotary(k, positions)
    return self.attend(q, k, v, attn_mask, deterministic)
