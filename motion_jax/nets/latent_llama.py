"""MotionStreamer's causal transformer: LLaMA's layers over a caption and latents, with a key-value cache.

Its outputs condition a diffusion head, `diffusion_mlp` (docs/papers/motionstreamer.md#transformer).
"""
import math
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.attention import Attention, RMSNorm, rotary
from motion_jax.nets.diffusion_mlp import DiffusionMLP
from motion_jax.nets.layers import Dense
from motion_jax.nets.masks import block_causal_mask
from motion_jax.shapes import Array, Bool, Float, Int, Whole

EPS = 1e-5


class LlamaCache(NamedTuple):
  """Rotated keys and values of all layers (N, B, max_length, H, K), and how many positions are filled."""
  keys: Float[Array, "n b s h k"]
  values: Float[Array, "n b s h k"]
  length: Int[Array, ""]


class LlamaBlock(nn.Module):
  """Attention and a gated feed-forward part, each after an RMS norm and without biases.

  Queries and keys are normalized to length 1 and rotated by their positions; scores are multiplied by `logit_scale`,
  which is not trained. Shapes: x (B, L, D), positions (L,), attn_mask (1, 1, L, S); past: keys and values
  (B, S, H, K) of a cache, in which the L positions from `start` are replaced by those of x.
  """
  num_heads: int
  mlp_width: int
  logit_scale: float
  dtype: Any = jnp.float32

  def setup(self) -> None:
    self.norm1, self.norm2 = RMSNorm(EPS, self.dtype), RMSNorm(EPS, self.dtype)

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"], positions: Int[Array, " l"], attn_mask: Bool[Array, "1 1 l s"],
               past: tuple[Array, Array] | None = None, start: Any = 0
               ) -> tuple[Float[Array, "b l d"], tuple[Any, Any]]:
    width = x.shape[-1]
    attention = Attention(width, self.num_heads, self.dtype, normalize="head", use_bias=False,
                          logit_scale=self.logit_scale, kernel_init=nn.initializers.lecun_uniform(), name="attn")
    y = self.norm1(x)
    q, (k, v) = attention.queries(y), attention.keys_values(y)
    q, k = rotary(q, positions), rotary(k, positions)
    if past is not None:
      put = lambda whole, part: jax.lax.dynamic_update_slice_in_dim(whole, part.astype(whole.dtype), start, axis=1)
      k, v = put(past[0], k), put(past[1], v)
    x = x + attention.attend(q, k, v, attn_mask)
    dense = lambda size, name, *axes: Dense(size, axes, use_bias=False, dtype=self.dtype, name=name)
    y = self.norm2(x)
    y = nn.silu(dense(self.mlp_width, "gate", "embed", "mlp")(y)) * dense(self.mlp_width, "up", "embed", "mlp")(y)
    return x + dense(width, "down", "mlp", "embed")(y), (k, v)


class LatentLlama(nn.Module):
  """text_emb (B, E), latents (B, L, C) -> conditions (B, 1 + L, D): row i, of the caption and i latents, is for the
  latent that follows.

  At most max_length - 1 latents. `init_cache` and `extend` compute the same rows, a few at a time.
  """
  latent_dim: int = 16
  width: int = 768
  depth: int = 12
  num_heads: int = 12
  text_dim: int = 768
  max_length: int = 78  # rows, including the caption's
  mlp_width: int = 0    # 0: 8 / 3 of the width, rounded up to a multiple of 256
  dtype: Any = jnp.float32

  def setup(self) -> None:
    hidden = self.mlp_width or -(-int(8 * self.width / 3) // 256) * 256
    scale = math.log2(self.max_length ** 2 - self.max_length)
    self.x_in = Dense(self.width, dtype=self.dtype)
    self.text_in = Dense(self.width, dtype=self.dtype)
    self.blocks = [LlamaBlock(self.num_heads, hidden, scale, self.dtype, name=f"block{i}") for i in range(self.depth)]
    self.norm = RMSNorm(EPS, self.dtype)
    self.out = Dense(self.width, dtype=self.dtype)

  def tokens(self, text_emb: Float[Array, "b e"], latents: Float[Array, "b l c"]) -> Float[Array, "b 1+l d"]:
    """Input rows of the blocks: the caption's, then those of the latents."""
    return jnp.concatenate([self.text_in(text_emb.astype(self.dtype))[:, None],
                            self.x_in(latents.astype(self.dtype))], axis=1)

  def __call__(self, text_emb: Float[Array, "b e"], latents: Float[Array, "b l c"]) -> Float[Array, "b 1+l d"]:
    x = self.tokens(text_emb, latents)
    length = x.shape[1]
    if length > self.max_length:
      raise ValueError(f"got {length - 1} latents, this transformer has places for {self.max_length - 1}")
    for block in self.blocks:
      x, _ = block(x, jnp.arange(length), block_causal_mask(length))
    return self.out(self.norm(x))

  def init_cache(self, batch: Whole) -> LlamaCache:
    """An empty cache."""
    shape = (self.depth, batch, self.max_length, self.num_heads, self.width // self.num_heads)
    return LlamaCache(jnp.zeros(shape, self.dtype), jnp.zeros(shape, self.dtype), jnp.zeros((), jnp.int32))

  def extend(self, tokens: Float[Array, "b n d"], cache: LlamaCache) -> tuple[Float[Array, "b n d"], LlamaCache]:
    """-> (conditions of the next rows, cache with them); tokens: of `tokens`.

    Rows after the filled positions are masked, so rows written there earlier do no harm and are overwritten.
    """
    count = tokens.shape[1]
    places = cache.length + jnp.arange(count)
    mask = (jnp.arange(self.max_length) <= places[:, None])[None, None]
    x, kept = tokens, []
    for block, k, v in zip(self.blocks, cache.keys, cache.values):
      x, rows = block(x, places, mask, (k, v), cache.length)
      kept.append(rows)
    keys, values = (jnp.stack(part) for part in zip(*kept))
    return self.out(self.norm(x)), LlamaCache(keys, values, cache.length + count)

  def start(self, text_emb: Float[Array, "b e"]) -> Float[Array, "b 1 d"]:
    """The caption's input row."""
    return self.text_in(text_emb.astype(self.dtype))[:, None]

  def follow(self, latents: Float[Array, "b n c"]) -> Float[Array, "b n d"]:
    """The latents' input rows."""
    return self.x_in(latents.astype(self.dtype))


class LatentGenerator(nn.Module):
  """A `LatentLlama` and its diffusion head, trained and saved together."""
  transformer: LatentLlama
  head: DiffusionMLP

  def condition(self, text_emb: Float[Array, "b e"], latents: Float[Array, "b l c"]) -> Float[Array, "b 1+l d"]:
    return self.transformer(text_emb, latents)

  def predict(self, x: Float[Array, "*lead c"], t: Int[Array, "*#lead"], condition: Float[Array, "*#lead d"]
              ) -> Float[Array, "*lead c"]:
    """Predicts the noise in latents x at steps t."""
    return self.head(x, t, condition)

  def init_cache(self, batch: Whole) -> LlamaCache:
    return self.transformer.init_cache(batch)

  def begin(self, text_emb: Float[Array, "b e"], cache: LlamaCache) -> tuple[Float[Array, "b 1 d"], LlamaCache]:
    """-> (conditions, cache) after the caption, the first row."""
    return self.transformer.extend(self.transformer.start(text_emb), cache)

  def extend(self, latents: Float[Array, "b n c"], cache: LlamaCache) -> tuple[Float[Array, "b n d"], LlamaCache]:
    """-> (conditions, cache) after further latents."""
    return self.transformer.extend(self.transformer.follow(latents), cache)

  def __call__(self, text_emb: Float[Array, "b e"], latents: Float[Array, "b l c"], t: Int[Array, "*#lead"]
               ) -> Float[Array, "b l c"]:
    """Touches every parameter, for init."""
    return self.head(latents, t, self.transformer(text_emb, latents)[:, :-1])
