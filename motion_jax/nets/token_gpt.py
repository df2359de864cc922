"""T2M-GPT's transformer: the next code of a motion from its caption and the codes before it.

Source: T2M-GPT, section 3.3; docs/papers/t2m_gpt.md#gpt.
"""
import functools
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.attention import Attention
from motion_jax.nets.layers import Dense, Dropout
from motion_jax.nets.masks import block_causal_mask
from motion_jax.nets.post_norm import sinusoids
from motion_jax.shapes import Array, AttentionMask, Float, Int

NORMAL = nn.initializers.normal(0.02)


class Cache(NamedTuple):
  """Keys and values (depth, B, S, H, K) of the tokens so far; later rows are unused."""
  keys: Float[Array, "n b s h k"]
  values: Float[Array, "n b s h k"]


class PreNormBlock(nn.Module):
  """Pre-norm attention and feed-forward part with residuals: x (B, L, D), attn_mask (B or 1, 1, L, S).

  items (B,), places in the whole batch, switch on dropout.
  """
  width: int
  num_heads: int
  ff_width: int
  dropout: float = 0.1
  dtype: Any = jnp.float32

  def setup(self) -> None:
    norm = lambda: nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False)
    self.norm1, self.norm2 = norm(), norm()
    self.attn = Attention(self.width, self.num_heads, self.dtype, normalize=False, kernel_init=NORMAL)
    self.ff_in = Dense(self.ff_width, kernel_init=NORMAL, dtype=self.dtype)
    self.ff_out = Dense(self.width, kernel_init=NORMAL, dtype=self.dtype)
    self.drop_weights, self.drop_attn, self.drop_ff = (Dropout(self.dropout) for _ in range(3))

  def _feed_forward(self, x: Array, items: Array | None) -> Array:
    return x + self.drop_ff(self.ff_out(jax.nn.gelu(self.ff_in(self.norm2(x)), approximate=False)), items)

  def __call__(self, x: Float[Array, "b l d"], attn_mask: AttentionMask,
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    drop = None if items is None or not self.dropout else functools.partial(self.drop_weights, items=items)
    x = x + self.drop_attn(self.attn(self.norm1(x), attn_mask=attn_mask, drop=drop), items)
    return self._feed_forward(x, items)

  def step(self, x: Float[Array, "b 1 d"], place: Int[Array, ""], keys: Float[Array, "b s h k"],
           values: Float[Array, "b s h k"]) -> tuple[Array, Array, Array]:
    """Runs one token at a position, given the keys and values of earlier ones -> (x, keys, values)."""
    y = self.norm1(x)
    key, value = self.attn.keys_values(y)
    put = lambda cache, new: jax.lax.dynamic_update_slice_in_dim(cache, new.astype(cache.dtype), place, axis=1)
    keys, values = put(keys, key), put(values, value)
    seen = (jnp.arange(keys.shape[1]) <= place)[None, None, None]
    x = x + self.attn.attend(self.attn.queries(y), keys, values, seen)
    return self._feed_forward(x, None), keys, values


class CodeGPT(nn.Module):
  """codes (B, n) in 0 .. K + 1, text_emb (B, E) -> logits (B, n + 1, K + 1) of the next code at each position.

  Position 0 is the text. Code K ends a motion; K + 1 is padding after it, an input only. At most max_length - 1 codes.
  """
  num_codes: int = 512
  width: int = 1024
  depth: int = 18
  num_heads: int = 16
  ff_width: int = 4096
  text_dim: int = 512
  max_length: int = 51
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @property
  def end_code(self) -> int:
    return self.num_codes

  @property
  def padding_code(self) -> int:
    return self.num_codes + 1

  def setup(self) -> None:
    self.code_table = self.param("code_table", NORMAL, (self.num_codes + 2, self.width))
    self.text_in = Dense(self.width, kernel_init=NORMAL, dtype=self.dtype)
    self.blocks = [PreNormBlock(self.width, self.num_heads, self.ff_width, self.dropout, self.dtype, name=f"block{i}")
                   for i in range(self.depth)]
    self.norm = nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False)
    self.out = Dense(self.num_codes + 1, use_bias=False, kernel_init=NORMAL, dtype=self.dtype)

  def hidden(self, codes: Int[Array, "b n"], text_emb: Float[Array, "b e"], items: Int[Array, " b"] | None = None,
             num_blocks: int | None = None) -> Float[Array, "b m d"]:
    """The residual stream (B, n + 1, D) after the first num_blocks blocks, by default all."""
    length = codes.shape[1] + 1
    if length > self.max_length:
      raise ValueError(f"got {length - 1} codes, this transformer has positions for {self.max_length - 1}")
    tokens = [self.text_in(text_emb.astype(self.dtype))[:, None], self.code_table[codes].astype(self.dtype)]
    x: Array = jnp.concatenate(tokens, axis=1) + sinusoids(length, self.width, self.dtype)
    for block in self.blocks[:num_blocks]:
      x = block(x, block_causal_mask(length), items)
    return x

  def __call__(self, codes: Int[Array, "b n"], text_emb: Float[Array, "b e"], items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b m k"]:
    return self.out(self.norm(self.hidden(codes, text_emb, items)))

  def init_cache(self, batch: int) -> Cache:
    shape = (self.depth, batch, self.max_length, self.num_heads, self.width // self.num_heads)
    return Cache(jnp.zeros(shape, self.dtype), jnp.zeros(shape, self.dtype))

  def step(self, codes: Int[Array, " b"], place: Int[Array, ""], text_emb: Float[Array, "b e"], cache: Cache
           ) -> tuple[Float[Array, "b k"], Cache]:
    """Logits (B, K + 1) of the code at position `place`, given the previous code, unused at 0, and the cache."""
    token = jnp.where(place == 0, self.text_in(text_emb.astype(self.dtype)), self.code_table[codes].astype(self.dtype))
    x: Array = (token + sinusoids(self.max_length, self.width, self.dtype)[place])[:, None]
    new_rows = []
    for block, keys, values in zip(self.blocks, *cache):
      x, *rows = block.step(x, place, keys, values)
      new_rows.append(rows)
    return self.out(self.norm(x))[:, 0], Cache(*(jnp.stack(rows) for rows in zip(*new_rows)))
