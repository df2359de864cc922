"""Post-norm transformer layers ("Attention is all you need"), of text encoders, teachers, evaluators and generators."""
from collections.abc import Callable
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.attention import Attention, dot_product_attention
from motion_jax.nets.layers import Dropout, promote_to_f32
from motion_jax.shapes import Array, Bool, Float, Int

ACTIVATIONS = {
    "gelu": lambda x: jax.nn.gelu(x, approximate=False),
    "gelu_new": lambda x: jax.nn.gelu(x, approximate=True),
    "gelu_pytorch_tanh": lambda x: jax.nn.gelu(x, approximate=True),
    "relu": jax.nn.relu,
}


def _dropout(rate: float, deterministic: bool, items: Array | None) -> tuple[Callable[[Array], Array], bool]:
  """(dropout function, whether it is active): by each item's place in the whole batch, or flax's over the batch."""
  if items is not None:
    return lambda y: Dropout(rate)(y, items), rate > 0
  return lambda y: nn.Dropout(rate, deterministic=deterministic)(y), not deterministic and rate > 0


class PostNormLayer(nn.Module):
  """Self-attention over all real rows, then a feed-forward part; each is added and then normalized.

  BERT's layer, and with eps 1e-5 PyTorch's TransformerEncoderLayer. Shapes: x (B, S, D), key_mask (B, S) True = real,
  or None, bias (H, S, S) or None is added to the scores -> (B, S, D). dropout acts on attention weights, inside the
  feed-forward part and on both branches, where `deterministic` is False; it then draws from the "dropout" rng. items
  (B,), places in the whole batch, switch it on too; then what an item loses does not depend on the others.
  """
  num_heads: int
  mlp_width: int
  activation: str = "gelu"
  eps: float = 1e-5
  dropout: float = 0.0
  dtype: Any = jnp.float32
  kernel_init: Any = nn.linear.default_kernel_init

  @nn.compact
  def __call__(self, x: Float[Array, "b s d"], key_mask: Bool[Array, "#b s"] | None = None, deterministic: bool = True,
               bias: Float[Array, "h s s"] | None = None, items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b s d"]:
    width = x.shape[-1]
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, kernel_init=self.kernel_init, name=name)
    norm = lambda name: nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False, name=name)
    drop: Callable[[Any], Any] = lambda y: (
        nn.Dropout(self.dropout, deterministic=deterministic)(y) if items is None else Dropout(self.dropout)(y, items))
    heads = lambda y: y.reshape(*y.shape[:-1], self.num_heads, width // self.num_heads)

    query, key, value = (heads(dense(width, name)(x)) for name in ("query", "key", "value"))
    mixed = dot_product_attention(query, key, value, None if key_mask is None else key_mask[:, None, None, :],
                                  None if bias is None else bias[None],
                                  drop=None if (deterministic and items is None) or not self.dropout else drop)
    x = norm("attn_norm")(x + drop(dense(width, "out")(mixed.reshape(x.shape))))
    y = drop(ACTIVATIONS[self.activation](dense(self.mlp_width, "mlp_in")(x)))
    return norm("mlp_norm")(x + drop(dense(width, "mlp_out")(y)))


class TokenTransformer(nn.Module):
  """A bidirectional transformer over learned tokens, then rows x (B, T, F), at sinusoidal positions.

  mask (B, T) True = real, or None -> outputs of tokens and rows (B, num_tokens + T, D). A single token is a parameter
  "token" (D,), several are "tokens" (num_tokens, D).
  """
  width: int
  depth: int
  num_heads: int
  mlp_width: int
  dropout: float = 0.1
  dtype: Any = jnp.float32
  num_tokens: int = 1

  @nn.compact
  def __call__(self, x: Float[Array, "b t f"], mask: Bool[Array, "#b t"] | None = None, deterministic: bool = True
               ) -> Float[Array, "b n d"]:
    x = nn.Dense(self.width, dtype=self.dtype, name="embed")(x)
    name, shape = ("token", (self.width,)) if self.num_tokens == 1 else ("tokens", (self.num_tokens, self.width))
    tokens = self.param(name, nn.initializers.normal(1.0), shape).astype(self.dtype)
    x = jnp.concatenate([jnp.broadcast_to(tokens, (len(x), self.num_tokens, self.width)), x], axis=1)
    x = x + sinusoids(x.shape[1], self.width, x.dtype)
    x = nn.Dropout(self.dropout, deterministic=deterministic)(x)
    if mask is not None:
      mask = jnp.pad(mask, ((0, 0), (self.num_tokens, 0)), constant_values=True)
    for i in range(self.depth):
      layer = PostNormLayer(self.num_heads, self.mlp_width, dropout=self.dropout, dtype=self.dtype, name=f"layer{i}")
      x = layer(x, mask, deterministic)
    return x


class PostNormDecoderLayer(nn.Module):
  """PyTorch's TransformerDecoderLayer: self-attention, attention to a memory, a feed-forward part; each is added and
  then normalized.

  Shapes: x (B, T, D), memory (B, M, D), attn_mask (B or 1, 1, 1 or T, T) of the self-attention, memory_mask (B, M),
  True = may attend; None: everything -> (B, T, D). dropout as in `PostNormLayer`.
  """
  num_heads: int
  mlp_width: int
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b t d"], memory: Float[Array, "b m d"],
               attn_mask: Bool[Array, "#b 1 #t t"] | None = None, deterministic: bool = True,
               memory_mask: Bool[Array, "b m"] | None = None, items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b t d"]:
    width = x.shape[-1]
    attention = lambda name: Attention(width, self.num_heads, self.dtype, normalize=False, name=name)
    norm = lambda name: nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name=name)
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, name=name)
    drop, drops = _dropout(self.dropout, deterministic, items)
    # A submodule of this layer, not of the attention that calls it.
    of_weights: Any = (Dropout(self.dropout) if items is not None else
                       nn.Dropout(self.dropout, deterministic=deterministic))
    drop_weights: Any = None if not drops else of_weights if items is None else lambda y: of_weights(y, items)
    y = attention("self_attn")(x, attn_mask=attn_mask, drop=drop_weights)
    x = norm("attn_norm")(x + drop(y))
    cross_mask = None if memory_mask is None else memory_mask[:, None, None, :]
    x = norm("cross_norm")(x + drop(attention("cross_attn")(x, memory, cross_mask, drop=drop_weights)))
    y = drop(ACTIVATIONS["gelu"](dense(self.mlp_width, "mlp_in")(x)))
    return norm("mlp_norm")(x + drop(dense(width, "mlp_out")(y)))


def sinusoids(length: int, width: int, dtype: Any = jnp.float32) -> Float[Array, "{length} {width}"]:
  """Sinusoidal positions (length, width): even columns sine, odd columns cosine, base 10000."""
  wide = promote_to_f32(dtype)
  rate = 10_000.0 ** (-jnp.arange(0, width, 2, dtype=wide) / width)
  angle = jnp.arange(length, dtype=wide)[:, None] * rate
  return jnp.stack([jnp.sin(angle), jnp.cos(angle)], axis=-1).reshape(length, -1)[:, :width].astype(dtype)


def sinusoid_table(length: int, width: int, cosines_first: bool = False) -> Float[np.ndarray, "{length} {width}"]:
  """Sinusoidal embeddings of the integers 0 .. length - 1, base 10000, as a table in float64.

  Pairs of sine and cosine, as in `sinusoids`; with cosines_first all cosines, then all sines. Computed in float32, the
  angle of step 999 would be off by up to 1e-4; callers round the table.
  """
  rates = 10_000.0 ** (-np.arange(0, width, 2) / width)
  angles = np.arange(length)[:, None] * rates
  if cosines_first:
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=-1)
  return np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(length, -1)[:, :width]
