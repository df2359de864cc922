"""Attention with normalized queries and keys and rotary positions, in the steps that a key-value cache needs."""
import functools
import math
from collections.abc import Callable
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.layers import Dense, promote_to_f32
from motion_jax.nets.partitioning import Axes, partitioned
from motion_jax.shapes import Array, Bool, Float, Num

IMPLEMENTATIONS = ("xla", "cudnn")
FUSED_WIDTHS = range(8, 129, 8)  # head widths that cuDNN's attention takes on every GPU; size S has heads of 256


class RMSNorm(nn.Module):
  """x / sqrt(mean(x^2) + eps) * scale over the last axis."""
  eps: float = 1e-6
  dtype: Any = jnp.float32
  axes: Axes = (None,)

  @nn.compact
  def __call__(self, x: Float[Array, "*lead d"]) -> Float[Array, "*lead d"]:
    scale = self.param("scale", partitioned(nn.initializers.ones, self.axes), (x.shape[-1],))
    y = x.astype(promote_to_f32(self.dtype))
    y = y * jax.lax.rsqrt((y * y).mean(-1, keepdims=True) + self.eps)
    return (y * scale).astype(self.dtype)


def rotary_table(positions: Num[Array, "*lead l"], size: int, dtype: Any = jnp.float32, base: float = 10_000.0
                 ) -> tuple[Float[Array, "*lead l 1 half"], Float[Array, "*lead l 1 half"]]:
  """Cosine and sine of the rotary angles of `size` channels at positions (..., L), for `turn`."""
  half, dtype = size // 2, promote_to_f32(dtype)
  angles = positions[..., None].astype(dtype) * base ** (-jnp.arange(half, dtype=dtype) / half)
  return jnp.cos(angles)[..., None, :], jnp.sin(angles)[..., None, :]


def turn(x: Float[Array, "*lead l h k"], table: tuple[Array, Array]) -> Float[Array, "*lead l h k"]:
  """Rotates adjacent pairs of channels of x (..., L, H, K) by a `rotary_table` of its positions."""
  cos, sin = table
  even, odd = x[..., 0::2], x[..., 1::2]
  turned = jnp.stack([even * cos - odd * sin, even * sin + odd * cos], axis=-1)
  return turned.reshape(x.shape).astype(x.dtype)


def rotary(x: Float[Array, "*lead l h k"], positions: Num[Array, "*#lead l"], base: float = 10_000.0
           ) -> Float[Array, "*lead l h k"]:
  """Rotary position embedding: rotates pair i of adjacent channels by position * base^(-2 i / K).

  x (..., L, H, K), positions (L,) or (..., L). Scores then depend on differences of positions only.
  """
  return turn(x, rotary_table(positions, x.shape[-1], x.dtype, base))


def dot_product_attention(q: Float[Array, "b l h k"], k: Float[Array, "b s h k"], v: Float[Array, "b s h k"],
                          attn_mask: Bool[Array, "#b #h #l s"] | None = None,
                          bias: Float[Array, "#b h l s"] | None = None, scaled: bool = True,
                          drop: Callable[[jax.Array], jax.Array] | None = None,
                          implementation: str = "xla") -> Float[Array, "b l h k"]:
  """softmax(q k^T / sqrt(K) + bias) v: the attention of every network here.

  attn_mask True = may attend; a row that may attend to nothing is finite. scaled=False: no division by sqrt(K), as in
  T5. drop: dropout, applied to the attention weights. implementation "cudnn": NVIDIA's fused kernel where it supports
  the type and shape, see `fused_attention`; "xla": matrix products and a softmax.
  """
  if implementation not in IMPLEMENTATIONS:
    raise ValueError(f"got attention {implementation!r}, expected one of {', '.join(IMPLEMENTATIONS)}")
  half = q.dtype in (jnp.bfloat16, jnp.float16)
  if implementation == "cudnn" and half and drop is None and bias is None and scaled and q.shape[-1] in FUSED_WIDTHS:
    return fused_attention(q, k, v, attn_mask)
  if drop is None and half:
    return jax.nn.dot_product_attention(q, k, v, None if bias is None else bias.astype(q.dtype), attn_mask,
                                        scale=None if scaled else 1.0)
  # JAX's own takes a softmax in float32 whatever the type, so float64 would not be float64, and has no dropout; it
  # multiplies scores by 1 / sqrt(K) where this divides, so float32 would differ in the last bit.
  scores = jnp.einsum("blhk,bshk->bhls", q, k, preferred_element_type=promote_to_f32(q.dtype))
  scores = scores / math.sqrt(q.shape[-1]) if scaled else scores
  if bias is not None:
    scores = scores + bias
  if attn_mask is not None:
    scores = jnp.where(attn_mask, scores, jnp.finfo(scores.dtype).min)
  weights = jax.nn.softmax(scores, axis=-1).astype(q.dtype)
  return jnp.einsum("bhls,bshk->blhk", weights if drop is None else drop(weights), v)


def fused_attention(q: Float[Array, "b l h k"], k: Float[Array, "b s h k"], v: Float[Array, "b s h k"],
                    attn_mask: Bool[Array, "#b #h #l s"] | None = None) -> Float[Array, "b l h k"]:
  """`dot_product_attention` by cuDNN in programs for CUDA devices, by matrix products in programs for others.

  For bfloat16 and float16 and heads of FUSED_WIDTHS. The kernel's gradient takes even lengths only, so odd ones are
  padded by a row, or by a key that no row attends to. Without an installed cuDNN JAX cannot trace the kernel, and the
  matrix products are used. Source:
  https://docs.nvidia.com/deeplearning/cudnn/frontend/latest/operations/Attention.html
  """
  plain, fused = (functools.partial(jax.nn.dot_product_attention, implementation=name) for name in ("xla", "cudnn"))
  length, odd_rows, odd_keys = q.shape[1], q.shape[1] % 2, k.shape[1] % 2
  mask = jnp.ones((1, 1, 1, 1), bool) if attn_mask is None else attn_mask
  mask = jnp.broadcast_to(mask, mask.shape[:2] + (length, k.shape[1]))
  mask = jnp.pad(mask, ((0, 0), (0, 0), (0, odd_rows), (0, odd_keys)))
  q = jnp.pad(q, ((0, 0), (0, odd_rows), (0, 0), (0, 0)))
  k, v = (jnp.pad(a, ((0, 0), (0, odd_keys), (0, 0), (0, 0))) for a in (k, v))
  call = lambda attend: lambda q, k, v, mask: attend(q, k, v, mask=mask)
  try:
    y = jax.lax.platform_dependent(q, k, v, mask, cuda=call(fused), default=call(plain))
  except RuntimeError as error:
    if "cuDNN" not in str(error):  # "cuDNN is not detected."
      raise
    y = plain(q, k, v, mask=mask)
  return y[:, :length]


class Attention(nn.Module):
  """Multi-head attention in three steps: `queries`, `keys_values`, `attend`.

  Queries and keys are RMS-normalized over the whole width before the heads are split (docs/papers/cmdm.md#causal-dit);
  with normalize="head" those of each head have length 1 instead, with normalize=False they are not normalized. Callers
  apply `rotary` between the steps, which lets a cache hold keys without positions. drop: dropout, applied to the
  attention weights. logit_scale: if not 0, scores are multiplied by it instead of being divided by sqrt(K); it is saved
  with the parameters, and no gradient reaches it. implementation: of `dot_product_attention`.
  Shapes: x (B, L, D); q, k, v (B, L, H, D / H); attn_mask (B or 1, 1, L, S).
  """
  width: int
  num_heads: int
  dtype: Any = jnp.float32
  normalize: bool | str = True
  kernel_init: Callable = nn.initializers.xavier_uniform()
  implementation: str = "xla"
  use_bias: bool = True
  logit_scale: float = 0.0

  def setup(self) -> None:
    if self.width % self.num_heads:
      raise ValueError(f"got width {self.width} for {self.num_heads} heads, expected a multiple")
    dense = lambda *axes: Dense(self.width, axes, use_bias=self.use_bias, kernel_init=self.kernel_init,
                                dtype=self.dtype)
    self.q, self.k, self.v = (dense("embed", "heads") for _ in range(3))
    self.o = dense("heads", "embed")
    norm = lambda: RMSNorm(dtype=self.dtype, axes=("heads",)) if self.normalize is True else lambda x: x
    self.norm_q, self.norm_k = norm(), norm()
    if self.logit_scale:
      self.scale = self.param("logit_scale", nn.initializers.constant(self.logit_scale), ())

  def _heads(self, x: Float[Array, "b l d"]) -> Float[Array, "b l h k"]:
    return x.reshape(x.shape[:-1] + (self.num_heads, self.width // self.num_heads))

  def _unit(self, x: Float[Array, "b l h k"]) -> Float[Array, "b l h k"]:
    if self.normalize != "head":
      return x
    return x / jnp.sqrt(jnp.maximum((x * x).sum(-1, keepdims=True), 1e-24))  # floor: no nan gradient at 0

  def queries(self, x: Float[Array, "b l d"]) -> Float[Array, "b l h k"]:
    q = self._unit(self._heads(self.norm_q(self.q(x))))
    return q * jax.lax.stop_gradient(self.scale).astype(q.dtype) if self.logit_scale else q

  def keys_values(self, x: Float[Array, "b s d"]) -> tuple[Float[Array, "b s h k"], Float[Array, "b s h k"]]:
    return self._unit(self._heads(self.norm_k(self.k(x)))), self._heads(self.v(x))

  def attend(self, q: Float[Array, "b l h k"], k: Float[Array, "b s h k"], v: Float[Array, "b s h k"],
             attn_mask: Bool[Array, "#b 1 #l s"] | None = None,
             drop: Callable[..., Any] | None = None) -> Float[Array, "b l d"]:
    return self.output(dot_product_attention(q, k, v, attn_mask, scaled=not self.logit_scale, drop=drop,
                                             implementation=self.implementation))

  def output(self, y: Float[Array, "b l h k"]) -> Float[Array, "b l d"]:
    """The output projection of the heads' weighted values, which with a single key are the values themselves."""
    return self.o(y.reshape(y.shape[:-2] + (self.width,)))

  def __call__(self, x: Float[Array, "b l d"], context: Float[Array, "b s d"] | None = None,
               attn_mask: Bool[Array, "#b 1 #l s"] | None = None, positions: Num[Array, "*#b l"] | None = None,
               drop: Callable[..., Any] | None = None) -> Float[Array, "b l d"]:
    """Self-attention, or cross-attention to a context (B, S, D)."""
    q, (k, v) = self.queries(x), self.keys_values(x if context is None else context)
    if positions is not None:
      q, k = rotary(q, positions), rotary(k, positions)
    return self.attend(q, k, v, attn_mask, drop)
