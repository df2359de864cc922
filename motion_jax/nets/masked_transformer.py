"""Masked transformers: from latents, some of them masked, and a caption to a condition for every latent's diffusion.

CDAMD's and, as its baseline, MARDM's (docs/papers/cdamd.md#masked-transformer). Both give (B, L, D), the residual
stream of their last block, to `nets.diffusion_mlp`, which makes a latent of each row.
"""
import functools
from typing import Any

import flax.linen as nn
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from motion_jax.nets.attention import Attention
from motion_jax.nets.layers import Dense, Dropout, layer_norm
from motion_jax.nets.masks import with_text
from motion_jax.nets.partitioning import partitioned
from motion_jax.nets.post_norm import sinusoids
from motion_jax.shapes import Array

NORMAL = nn.initializers.normal(0.02)
SIZES = {"readme": dict(width=512, depth=4, num_heads=8, ff_width=1024, dropout=0.2),
         "large": dict(width=1024, depth=8, num_heads=8, ff_width=4096, dropout=0.1),
         "options": dict(width=384, depth=8, num_heads=6, ff_width=1024, dropout=0.2)}


def size(name: str, **fields: Any) -> dict[str, Any]:
  """Fields of a size of CDAMD's transformer (docs/papers/cdamd.md#sizes).

  Parity: the paper's (8 layers of width 1024 with 6 heads) cannot exist; "readme" is the released training command,
  "options" its options' defaults, "large" the paper's with 8 heads.
  """
  if name not in SIZES:
    raise ValueError(f"got size {name!r}, expected one of {', '.join(SIZES)}")
  return SIZES[name] | fields


class Inputs(nn.Module):
  """What both transformers begin with: latents and words as tokens, and the latent that stands for a masked one."""
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

  def embed(self, tokens: Float[Array, "b l d"], items: Int[Array, " b"] | None) -> Float[Array, "b l d"]:
    """Tokens (B, L, D) with their fixed positions, then dropout."""
    return self.drop(tokens + sinusoids(tokens.shape[1], tokens.shape[2], self.dtype), items)

  def latents(self, x: Float[Array, "b l c"], items: Int[Array, " b"] | None) -> Float[Array, "b l d"]:
    return self.embed(self.x_in(x.astype(self.dtype)), items)

  def words(self, text_emb: Float[Array, "b s e"]) -> Float[Array, "b s d"]:
    return self.text_in(text_emb.astype(self.dtype) * self.text_scale)

  def mask_token(self) -> Float[Array, "1 1 c"]:
    """(1, 1, C): what a masked latent is replaced by."""
    return self.mask_latent


class Block(nn.Module):
  """Self-attention, cross-attention to the conditions, feed-forward, each behind a norm that the caption modulates.

  Shapes: x (B, L, D), cond (B, S + L, D), text (B, 1, D), masks (B, 1, L, L) and (B, 1, L, S + L) -> (B, L, D).
  """
  num_heads: int
  ff_width: int
  dropout: float
  dtype: Any
  attention: str = "xla"

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"], cond: Float[Array, "b s d"], text: Float[Array, "b 1 d"],
               attn_mask: Bool[Array, "#b 1 l l"], cross_mask: Bool[Array, "b 1 l s"],
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    width = x.shape[-1]
    dense = lambda size, name, *axes: Dense(size, axes, kernel_init=NORMAL, dtype=self.dtype, name=name)
    drop = lambda y: Dropout(self.dropout)(y, items)
    drop_weights = None if items is None or not self.dropout else functools.partial(Dropout(self.dropout), items=items)
    attention = lambda name: Attention(width, self.num_heads, self.dtype, normalize=False, kernel_init=NORMAL,
                                       implementation=self.attention, name=name)

    def norm(x, i):
      scale, shift = (dense(width, f"{name}{i}", "embed", "film")(text) for name in ("scale", "shift"))
      return layer_norm(1e-5, self.dtype)(x) * (1 + scale) + shift

    y = attention("self_attn")(norm(x, 1), attn_mask=attn_mask, drop=drop_weights)
    x = x + drop(y)
    y = attention("cross_attn")(norm(x, 2), cond, cross_mask, drop=drop_weights)
    x = x + drop(y)
    y = drop(nn.gelu(dense(self.ff_width, "ff_in", "embed", "mlp")(norm(x, 3)), approximate=False))
    return x + drop(dense(width, "ff_out", "mlp", "embed")(y))


class MaskedTransformer(nn.Module):
  """CDAMD's: x (B, L, C) latents, the masked ones replaced by `mask_token()`, zero at padding -> conditions (B, L, D).

  text_emb (B, S, E): a sentence vector (S = 1) or words, of which the first modulates the norms; all 0 stands for no
  caption. text_mask (B, S). attn_mask (B, 1, L, L), see `nets.masks.latent_mask`; prior tokens are looked at like the
  latents whose codes they are. codes: of one level (B, L), or of several (B, L, Q), or None; prior_mask (B,) False
  takes an item's codes away, which is the same as None. items (B,), places in the whole batch, switch on dropout, which
  needs rngs={"dropout": key}.
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
  separate_levels: bool = False  # a table for each level and their sum, instead of one for all and the mean
  max_length: int = 200
  dropout: float = 0.2
  dtype: Any = jnp.float32
  remat: bool = False  # a gradient computes what is inside of a block once more, instead of keeping it
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
    self.blocks = [block(self.num_heads, self.ff_width, self.dropout, self.dtype, self.attention, name=f"block{i}")
                   for i in range(self.depth)]

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.inputs.mask_token()

  def prior(self, codes: Int[Array, "b l *q"]) -> Float[Array, "b l d"]:
    """Prior tokens (B, L, D). Several levels have a row of their own added and are averaged, one alone has not."""
    # Parity: the paper does not say how levels are put together; this is the code's way, separate_levels the option.
    if self.separate_levels:
      codes = codes[..., None] if codes.ndim == 2 else codes
      return self.code_table[jnp.arange(codes.shape[-1]), codes].sum(-2).astype(self.dtype)
    if codes.ndim == 2:
      return self.code_table[codes].astype(self.dtype)
    return (self.code_table[codes] + self.level_table[:codes.shape[-1]]).mean(-2).astype(self.dtype)

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: Bool[Array, "#b 1 l l"],
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
  """Self-attention and feed-forward whose scale, shift and gate come from the caption; the identity at first."""
  num_heads: int
  ff_width: int
  dropout: float
  dtype: Any
  attention: str = "xla"

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"], text: Float[Array, "b 1 d"], attn_mask: Bool[Array, "#b 1 l l"],
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    width = x.shape[-1]
    dense = lambda size, name, *axes: Dense(size, axes, kernel_init=NORMAL, dtype=self.dtype, name=name)
    film = Dense(6 * width, ("embed", "film"), kernel_init=nn.initializers.zeros, dtype=self.dtype, name="film")(
        nn.silu(text))
    shift1, scale1, gate1, shift2, scale2, gate2 = jnp.split(film, 6, axis=-1)
    norm = layer_norm(1e-6, self.dtype)
    drop = lambda y: Dropout(self.dropout)(y, items)
    attention = Attention(width, self.num_heads, self.dtype, normalize=False, kernel_init=NORMAL,
                          implementation=self.attention, name="self_attn")
    drop_weights = None if items is None or not self.dropout else functools.partial(Dropout(self.dropout), items=items)
    y = attention(norm(x) * (1 + scale1) + shift1, attn_mask=attn_mask, drop=drop_weights)
    x = x + gate1 * drop(y)
    y = nn.gelu(dense(self.ff_width, "ff_in", "embed", "mlp")(norm(x) * (1 + scale2) + shift2), approximate=True)
    return x + gate2 * dense(width, "ff_out", "mlp", "embed")(y)


class GatedTransformer(nn.Module):
  """MARDM's, called like `MaskedTransformer`; it has no prior and takes the first word's vector.

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
  remat: bool = False  # a gradient computes what is inside of a block once more, instead of keeping it
  attention: str = "xla"  # of `attention.dot_product_attention`; attention with dropout is always plain

  def setup(self) -> None:
    self.inputs = Inputs(self.latent_dim, self.width, self.text_scale, self.dropout, self.dtype)
    block = nn.remat(GatedBlock) if self.remat else GatedBlock
    self.blocks = [block(self.num_heads, self.ff_width, self.dropout, self.dtype, self.attention, name=f"block{i}")
                   for i in range(self.depth)]

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.inputs.mask_token()

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: Bool[Array, "#b 1 l l"],
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
