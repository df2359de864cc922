"""Masked transformers: from latents, some of them masked, and a caption to a condition for every latent's diffusion.

CDAMD's and, as its baseline, MARDM's (docs/papers/cdamd.md#masked-transformer). Both return (B, L, D), the residual
stream of their last block; `nets.diffusion_mlp` generates a latent from each row.
"""
import functools
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.attention import Attention
from motion_jax.nets.layers import Dense, Dropout, layer_norm
from motion_jax.nets.masks import with_text
from motion_jax.nets.partitioning import partitioned
from motion_jax.nets.post_norm import sinusoids
from motion_jax.shapes import Array, AttentionMask, Bool, Float, Int

NORMAL = nn.initializers.normal(0.02)
SIZES = {"readme": dict(width=512, depth=4, num_heads=8, ff_width=1024, dropout=0.2),
         "large": dict(width=1024, depth=8, num_heads=8, ff_width=4096, dropout=0.1),
         "options": dict(width=384, depth=8, num_heads=6, ff_width=1024, dropout=0.2)}
# Not of the paper: a quarter or a third of generators of 1 and 3 billion parameters (`diffusion_mlp.LARGER_SIZES`).
LARGER_SIZES = {"1B": dict(width=1536, depth=4, num_heads=12, ff_width=6144, dropout=0.1),
                "3B": dict(width=2048, depth=10, num_heads=16, ff_width=8192, dropout=0.1)}


def size(name: str, **fields: Any) -> dict[str, Any]:
  """Fields of a size of CDAMD's transformer (docs/papers/cdamd.md#sizes).

  Parity: the paper's (8 layers of width 1024 with 6 heads) cannot exist; "readme" is the released training command,
  "options" its options' defaults, "large" the paper's with 8 heads.
  """
  sizes = SIZES | LARGER_SIZES
  if name not in sizes:
    raise ValueError(f"got size {name!r}, expected one of {', '.join(sizes)}")
  return sizes[name] | fields


Cache = tuple[Array, Array]  # keys and values (B, L, H, D / H) of one block's self-attention


def with_window(cache: Cache | None, window: Cache, start: Int[Array, " b"] | None) -> Cache:
  """Writes a window's keys and values into the cache from position start on; without start the window is the whole."""
  if cache is None or start is None:
    return window
  put = jax.vmap(functools.partial(jax.lax.dynamic_update_slice_in_dim, axis=0))
  return put(cache[0], window[0], start), put(cache[1], window[1], start)


def rows_from(table: Float[Array, "l d"], start: Int[Array, " b"] | None, count: int) -> Float[Array, "#b w d"]:
  """`count` rows of a table of positions, from the first or, with start (B,), from each motion's start on."""
  if start is None:
    return table[None, :count]
  return jax.vmap(lambda first: jax.lax.dynamic_slice_in_dim(table, first, count))(start)


def empty_caches(transformer: Any, batch: int, length: int) -> tuple[Cache, ...]:
  """Empty caches of all blocks, for the first `window`."""
  shape = (batch, length, transformer.num_heads, transformer.width // transformer.num_heads)
  return tuple((jnp.zeros(shape, transformer.dtype), jnp.zeros(shape, transformer.dtype))
               for _ in range(transformer.depth))


class Inputs(nn.Module):
  """Input layers of both transformers: embeddings of latents and words, and the learned mask token."""
  latent_dim: int
  width: int
  text_scale: float
  dropout: float
  dtype: Any

  def setup(self) -> None:
    self.mask_latent = self.param("mask_latent", nn.initializers.zeros, (1, 1, self.latent_dim))
    self.x_in = Dense(self.width, (None, "embed"), kernel_init=NORMAL, dtype=self.dtype)
    self.text_in = Dense(self.width, (None, "embed"), kernel_init=NORMAL, dtype=self.dtype)
    self.drop = Dropout(self.dropout)

  def embed(self, tokens: Float[Array, "b l d"], items: Int[Array, " b"] | None,
            start: Int[Array, " b"] | None = None, length: int = 0) -> Float[Array, "b l d"]:
    """Tokens (B, L, D) plus sinusoidal positions, from start on of `length`, then dropout."""
    table = sinusoids(length or tokens.shape[1], tokens.shape[2], self.dtype)
    return self.drop(tokens + rows_from(table, start, tokens.shape[1]), items)

  def latents(self, x: Float[Array, "b l c"], items: Int[Array, " b"] | None,
              start: Int[Array, " b"] | None = None, length: int = 0) -> Float[Array, "b l d"]:
    return self.embed(self.x_in(x.astype(self.dtype)), items, start, length)

  def words(self, text_emb: Float[Array, "b s e"]) -> Float[Array, "b s d"]:
    return self.text_in(text_emb.astype(self.dtype) * self.text_scale)

  def mask_token(self) -> Float[Array, "1 1 c"]:
    """The learned latent (1, 1, C) that replaces masked ones."""
    return self.mask_latent


class TextState(NamedTuple):
  """A caption's precomputed inputs of one block: scale and shift of each norm (B, 1, D), and keys and values
  (B, S, H, D / H) of the cross-attention or, with a single token to attend to, its output (B, 1, D)."""
  modulation: tuple[tuple[Array, Array], ...]
  cross: Any


class Block(nn.Module):
  """Self-attention, cross-attention to the conditions, feed-forward, each after a norm that the caption modulates.

  Shapes: x (B, L, D), cond (B, S + L, D), text (B, 1, D), masks (B, 1, L, L) and (B, 1, L, S + L) -> (B, L, D).
  """
  width: int
  num_heads: int
  ff_width: int
  dropout: float
  dtype: Any
  attention: str = "xla"

  def setup(self) -> None:
    dense = lambda size, *axes: Dense(size, axes, kernel_init=NORMAL, dtype=self.dtype)
    attention = lambda: Attention(self.width, self.num_heads, self.dtype, normalize=False, kernel_init=NORMAL,
                                  implementation=self.attention)
    self.scale1, self.scale2, self.scale3 = (dense(self.width, "embed", "film") for _ in range(3))
    self.shift1, self.shift2, self.shift3 = (dense(self.width, "embed", "film") for _ in range(3))
    self.self_attn, self.cross_attn = attention(), attention()
    self.ff_in, self.ff_out = dense(self.ff_width, "embed", "mlp"), dense(self.width, "mlp", "embed")
    self.norm = layer_norm(1e-5, self.dtype)
    self.drops = [Dropout(self.dropout, name=f"Dropout_{i}") for i in range(5)]

  def text_state(self, cond: Float[Array, "b s d"], text: Float[Array, "b 1 d"], training: bool = False) -> TextState:
    scales, shifts = (self.scale1, self.scale2, self.scale3), (self.shift1, self.shift2, self.shift3)
    keys, values = self.cross_attn.keys_values(cond)
    # A softmax over a single key is 1 for any query. Not in training, where dropout acts on it, nor in init.
    single = keys.shape[1] == 1 and not training and not self.is_initializing()
    return TextState(tuple((scale(text), shift(text)) for scale, shift in zip(scales, shifts)),
                     self.cross_attn.output(values) if single else (keys, values))

  def run(self, x: Float[Array, "b w d"], state: TextState, attn_mask: Bool[Array, "#b 1 w l"],
          cross_mask: Bool[Array, "b 1 w s"], items: Int[Array, " b"] | None = None, cache: Cache | None = None,
          start: Int[Array, " b"] | None = None) -> tuple[Float[Array, "b w d"], Cache]:
    """Runs x at the positions from start on, with other positions' keys and values in the cache -> (y, new cache)."""
    drop_weights = None if items is None or not self.dropout else functools.partial(self.drops[0], items=items)
    norm = lambda x, i: self.norm(x) * (1 + state.modulation[i][0]) + state.modulation[i][1]
    y = norm(x, 0)
    cache = with_window(cache, self.self_attn.keys_values(y), start)
    y = self.self_attn.attend(self.self_attn.queries(y), cache[0], cache[1], attn_mask, drop_weights)
    x = x + self.drops[1](y, items)
    if isinstance(state.cross, tuple):
      keys, values = state.cross
      y = self.cross_attn.attend(self.cross_attn.queries(norm(x, 1)), keys, values, cross_mask, drop_weights)
      x = x + self.drops[2](y, items)
    else:
      x = x + state.cross
    y = self.drops[3](nn.gelu(self.ff_in(norm(x, 2)), approximate=False), items)
    return x + self.drops[4](self.ff_out(y), items), cache

  def __call__(self, x: Float[Array, "b l d"], cond: Float[Array, "b s d"], text: Float[Array, "b 1 d"],
               attn_mask: AttentionMask, cross_mask: Bool[Array, "b 1 l s"],
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    return self.run(x, self.text_state(cond, text, items is not None), attn_mask, cross_mask, items)[0]


class MaskedTransformer(nn.Module):
  """CDAMD's transformer: latents x (B, L, C) -> conditions (B, L, D).

  Masked latents are `mask_token()`, padding is zero. text_emb (B, S, E): a sentence vector (S = 1) or words, of which
  the first modulates the norms; all 0 stands for no caption. text_mask (B, S). attn_mask (B, 1, L, L), see
  `nets.masks.latent_mask`; it also applies to prior tokens, as to the latents whose codes they embed. codes: of one
  level (B, L), or of several (B, L, Q), or None; prior_mask (B,) False drops an item's codes, which is the same as
  None. items (B,), places in the whole batch, switch on dropout, which needs rngs={"dropout": key}.
  """
  latent_dim: int = 512
  width: int = 512
  depth: int = 4
  num_heads: int = 8
  ff_width: int = 1024
  text_dim: int = 512
  text_scale: float = 1.0  # sqrt(text_dim) for sentence vectors of length 1; CLIP's are ten times as long
  num_codes: int = 1027  # Parity: rows of the reference's table, of which 512 are used
  num_levels: int = 4
  separate_levels: bool = False  # sum of one table per level, instead of the mean of one table for all
  max_length: int = 200
  dropout: float = 0.2
  dtype: Any = jnp.float32
  remat: bool = False  # recompute each block in the backward pass instead of storing its activations
  attention: str = "xla"  # of `attention.dot_product_attention`; attention with dropout is always plain

  def setup(self) -> None:
    self.inputs = Inputs(self.latent_dim, self.width, self.text_scale, self.dropout, self.dtype)
    table = lambda name, *rows: self.param(
        name, partitioned(NORMAL, (None,) * len(rows) + ("embed",)), (*rows, self.width))
    if self.separate_levels:
      self.code_table = table("code_table", self.num_levels, self.num_codes)
    else:
      self.code_table = table("code_table", self.num_codes)
      self.level_table = table("level_table", self.num_levels)
    # Parity: the code adds learned positions to the sines, at their initial size of 1.
    self.positions = self.param("positions", nn.initializers.normal(1.0), (1, self.max_length, self.width))
    block = nn.remat(Block) if self.remat else Block
    self.blocks = [block(self.width, self.num_heads, self.ff_width, self.dropout, self.dtype, self.attention,
                         name=f"block{i}") for i in range(self.depth)]

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.inputs.mask_token()

  def text_state(self, text_emb: Float[Array, "b s e"]) -> tuple[TextState, ...]:
    """Each block's `TextState` of a caption, for `window`."""
    words = self.inputs.words(text_emb)
    return tuple(block.text_state(words, words[:, :1]) for block in self.blocks)

  def window(self, x: Float[Array, "b w c"], state: tuple[TextState, ...], attn_mask: Bool[Array, "#b 1 w l"],
             text_mask: Bool[Array, "b s"] | None = None, caches: tuple[Cache, ...] | None = None,
             start: Int[Array, " b"] | None = None) -> tuple[Float[Array, "b w d"], tuple[Cache, ...]]:
    """Conditions of W latents of each motion from position start (B,) on, and the updated caches of all L.

    Without start the window is the whole motion. The result is that of `__call__` without codes.
    """
    positions = rows_from(self.positions[0], start, x.shape[1]).astype(self.dtype)
    y = self.inputs.latents(x, None, start, attn_mask.shape[-1]) + positions
    if text_mask is None:
      text_mask = jnp.ones((x.shape[0], 1), bool)
    cross_mask = jnp.broadcast_to(text_mask[:, None, None], (x.shape[0], 1, x.shape[1], text_mask.shape[1]))
    new_caches = []
    for i, block in enumerate(self.blocks):
      y, cache = block.run(y, state[i], attn_mask, cross_mask, cache=caches[i] if caches else None, start=start)
      new_caches.append(cache)
    return y, tuple(new_caches)

  def prior(self, codes: Int[Array, "b l *q"]) -> Float[Array, "b l d"]:
    """Prior tokens (B, L, D): embedded codes; of several levels the mean, each with a learned row added, or the sum."""
    # Parity: the paper does not say how levels are combined; this is the code's way, separate_levels an option.
    if self.separate_levels:
      codes = codes[..., None] if codes.ndim == 2 else codes
      return self.code_table[jnp.arange(codes.shape[-1]), codes].sum(-2).astype(self.dtype)
    if codes.ndim == 2:
      return self.code_table[codes].astype(self.dtype)
    return (self.code_table[codes] + self.level_table[:codes.shape[-1]]).mean(-2).astype(self.dtype)

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: AttentionMask,
               codes: Int[Array, "b l *q"] | None = None, prior_mask: Bool[Array, " b"] | None = None,
               text_mask: Bool[Array, "b s"] | None = None, items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b l d"]:
    batch, length = x.shape[:2]
    if length > self.max_length:
      raise ValueError(f"got {length} latents, this transformer has positions for {self.max_length}")
    if text_mask is None:
      text_mask = jnp.ones(text_emb.shape[:2], bool)
    cond = words = self.inputs.words(text_emb)
    prior_columns: Array = jnp.zeros((batch, 1, length, 0), bool)
    if codes is not None:
      cond = jnp.concatenate([words, self.inputs.embed(self.prior(codes), items)], axis=1)
      prior_columns = attn_mask
      if prior_mask is not None:
        prior_columns = prior_columns & prior_mask[:, None, None, None]
    cross_mask = with_text(prior_columns, text_mask)
    x = self.inputs.latents(x, items) + self.positions[:, :length].astype(self.dtype)
    for block in self.blocks:
      x = block(x, cond, words[:, :1], attn_mask, cross_mask, items)
    return x


class GatedBlock(nn.Module):
  """Self-attention and feed-forward with scale, shift and gate from the caption; the identity at initialization."""
  width: int
  num_heads: int
  ff_width: int
  dropout: float
  dtype: Any
  attention: str = "xla"

  def setup(self) -> None:
    dense = lambda size, *axes: Dense(size, axes, kernel_init=NORMAL, dtype=self.dtype)
    self.film = Dense(6 * self.width, ("embed", "film"), kernel_init=nn.initializers.zeros, dtype=self.dtype)
    self.self_attn = Attention(self.width, self.num_heads, self.dtype, normalize=False, kernel_init=NORMAL,
                               implementation=self.attention)
    self.ff_in, self.ff_out = dense(self.ff_width, "embed", "mlp"), dense(self.width, "mlp", "embed")
    self.norm = layer_norm(1e-6, self.dtype)
    self.drops = [Dropout(self.dropout, name=f"Dropout_{i}") for i in range(2)]

  def text_state(self, text: Float[Array, "b 1 d"]) -> tuple[Array, ...]:
    """Shift, scale and gate (B, 1, D) of the attention, then of the feed-forward."""
    return tuple(jnp.split(self.film(nn.silu(text)), 6, axis=-1))

  def run(self, x: Float[Array, "b w d"], state: tuple[Array, ...], attn_mask: Bool[Array, "#b 1 w l"],
          items: Int[Array, " b"] | None = None, cache: Cache | None = None, start: Int[Array, " b"] | None = None
          ) -> tuple[Float[Array, "b w d"], Cache]:
    """As `Block.run`."""
    shift1, scale1, gate1, shift2, scale2, gate2 = state
    drop_weights = None if items is None or not self.dropout else functools.partial(self.drops[0], items=items)
    y = self.norm(x) * (1 + scale1) + shift1
    cache = with_window(cache, self.self_attn.keys_values(y), start)
    y = self.self_attn.attend(self.self_attn.queries(y), cache[0], cache[1], attn_mask, drop_weights)
    x = x + gate1 * self.drops[1](y, items)
    y = nn.gelu(self.ff_in(self.norm(x) * (1 + scale2) + shift2), approximate=True)
    return x + gate2 * self.ff_out(y), cache

  def __call__(self, x: Float[Array, "b l d"], text: Float[Array, "b 1 d"], attn_mask: AttentionMask,
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    return self.run(x, self.text_state(text), attn_mask, items)[0]


class GatedTransformer(nn.Module):
  """MARDM's transformer, called like `MaskedTransformer`; it has no prior and uses the first word's vector only.

  Source: docs/papers/cdamd.md#mardm.
  """
  latent_dim: int = 512
  width: int = 1024
  depth: int = 1
  num_heads: int = 16
  ff_width: int = 4096
  text_dim: int = 512
  text_scale: float = 1.0
  dropout: float = 0.2
  dtype: Any = jnp.float32
  remat: bool = False  # recompute each block in the backward pass instead of storing its activations
  attention: str = "xla"  # of `attention.dot_product_attention`; attention with dropout is always plain

  def setup(self) -> None:
    self.inputs = Inputs(self.latent_dim, self.width, self.text_scale, self.dropout, self.dtype)
    block = nn.remat(GatedBlock) if self.remat else GatedBlock
    self.blocks = [block(self.width, self.num_heads, self.ff_width, self.dropout, self.dtype, self.attention,
                         name=f"block{i}") for i in range(self.depth)]

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.inputs.mask_token()

  def text_state(self, text_emb: Float[Array, "b s e"]) -> tuple[tuple[Array, ...], ...]:
    text = self.inputs.words(text_emb[:, :1])
    return tuple(block.text_state(text) for block in self.blocks)

  def window(self, x: Float[Array, "b w c"], state: tuple[tuple[Array, ...], ...], attn_mask: Bool[Array, "#b 1 w l"],
             text_mask: Bool[Array, "b s"] | None = None, caches: tuple[Cache, ...] | None = None,
             start: Int[Array, " b"] | None = None) -> tuple[Float[Array, "b w d"], tuple[Cache, ...]]:
    """As `MaskedTransformer.window`."""
    length = attn_mask.shape[-1]
    y, new_caches = self.inputs.latents(x, None, start, length), []
    for i, block in enumerate(self.blocks):
      y, cache = block.run(y, state[i], attn_mask, cache=caches[i] if caches else None, start=start)
      new_caches.append(cache)
    return y, tuple(new_caches)

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: AttentionMask,
               codes: Int[Array, "b l *q"] | None = None, prior_mask: Bool[Array, " b"] | None = None,
               text_mask: Bool[Array, "b s"] | None = None, items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b l d"]:
    if codes is not None:
      raise ValueError("got codes, MARDM's transformer has no prior; set loss.prior_levels = 0")
    text = self.inputs.words(text_emb[:, :1])
    x = self.inputs.latents(x, items)
    for block in self.blocks:
      x = block(x, text, attn_mask, items)
    return x


TRANSFORMERS = {"cdamd": MaskedTransformer, "mardm": GatedTransformer}
