"""MoMask's transformers on codes of a residual quantizer: one fills masked codes of level 0, one predicts later levels.

Source: MoMask, section 3; docs/papers/momask.md#transformers. Both run bidirectional post-norm layers, without a final
norm, over [text | codes]; the text is one token, a sentence vector, all 0 for no caption.
"""
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.layers import Dense, Dropout
from motion_jax.nets.post_norm import PostNormLayer, sinusoids
from motion_jax.shapes import Array, Bool, Float, Int

NORMAL = nn.initializers.normal(0.02)


class CodeTrunk(nn.Module):
  """Embedded codes x (B, L, C), text_emb (B, E), lead (B, D) or None, real_mask (B, L) -> (B, L, D).

  Tokens are [text | lead | codes]; code i has position i, with or without lead. items (B,), places in the whole batch,
  switch on dropout, which needs rngs={"dropout": key}.
  """
  width: int
  depth: int
  num_heads: int
  ff_width: int
  dropout: float
  dtype: Any

  def setup(self) -> None:
    dense = lambda: Dense(self.width, kernel_init=NORMAL, dtype=self.dtype)
    self.x_in, self.text_in = dense(), dense()
    self.drop = Dropout(self.dropout)
    self.layers = [PostNormLayer(self.num_heads, self.ff_width, dropout=self.dropout, dtype=self.dtype,
                                 kernel_init=NORMAL, name=f"layer{i}") for i in range(self.depth)]

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b e"], real_mask: Bool[Array, "b l"],
               items: Int[Array, " b"] | None = None, lead: Float[Array, "b d"] | None = None
               ) -> Float[Array, "b l d"]:
    x = self.x_in(x.astype(self.dtype))
    x = self.drop(x + sinusoids(x.shape[1], self.width, self.dtype), items)
    front = [self.text_in(text_emb.astype(self.dtype))] + ([] if lead is None else [lead.astype(self.dtype)])
    x = jnp.concatenate([jnp.stack(front, axis=1), x], axis=1)
    key_mask = jnp.pad(real_mask, ((0, 0), (len(front), 0)), constant_values=True)
    for layer in self.layers:
      x = layer(x, key_mask, items=items)
    return x[:, len(front):]


class CodeHead(nn.Module):
  """Output head (B, L, D) -> (B, L, out): dense, GELU, norm, dense."""
  out: int
  dtype: Any

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"]) -> Float[Array, "b l out"]:
    dense = lambda size, name: Dense(size, kernel_init=NORMAL, dtype=self.dtype, name=name)
    x = jax.nn.gelu(dense(x.shape[-1], "dense")(x), approximate=False)
    x = nn.LayerNorm(epsilon=1e-12, dtype=self.dtype, use_fast_variance=False, name="norm")(x)
    return dense(self.out, "out")(x)


class MaskedCodeTransformer(nn.Module):
  """codes (B, L) in 0 .. K + 1, text_emb (B, E), real_mask (B, L) -> logits (B, L, K) of the codes of level 0.

  Code K is the mask token, K + 1 padding; neither is an output.
  """
  num_codes: int = 512
  code_dim: int = 512
  width: int = 384
  depth: int = 8
  num_heads: int = 6
  ff_width: int = 1024
  text_dim: int = 512
  dropout: float = 0.2
  dtype: Any = jnp.float32

  @property
  def mask_code(self) -> int:
    return self.num_codes

  @property
  def padding_code(self) -> int:
    return self.num_codes + 1

  def setup(self) -> None:
    self.code_table = self.param("code_table", NORMAL, (self.num_codes + 2, self.code_dim))
    self.trunk = CodeTrunk(self.width, self.depth, self.num_heads, self.ff_width, self.dropout, self.dtype)
    self.head = CodeHead(self.num_codes, self.dtype)

  def hidden(self, codes: Int[Array, "b l"], text_emb: Float[Array, "b e"], real_mask: Bool[Array, "b l"],
             items: Int[Array, " b"] | None = None) -> Float[Array, "b l d"]:
    """The output of the last layer, before the head."""
    return self.trunk(self.code_table[codes], text_emb, real_mask, items)

  def __call__(self, codes: Int[Array, "b l"], text_emb: Float[Array, "b e"], real_mask: Bool[Array, "b l"],
               items: Int[Array, " b"] | None = None) -> Float[Array, "b l k"]:
    return self.head(self.hidden(codes, text_emb, real_mask, items))


class ResidualCodeTransformer(nn.Module):
  """Logits (B, L, K + 1) of the codes of one level, 1 .. Q - 1 for each item, from the sum of all levels below.

  history (B, L, C) of `history`, level (B,), text_emb (B, E), real_mask (B, L). Code K is padding, and an output.
  shared_tables: one table per level is both the input embedding and the output weights.
  """
  num_codes: int = 512
  code_dim: int = 512
  num_levels: int = 6
  width: int = 384
  depth: int = 8
  num_heads: int = 6
  ff_width: int = 1024
  text_dim: int = 512
  dropout: float = 0.2
  shared_tables: bool = True
  dtype: Any = jnp.float32

  @property
  def padding_code(self) -> int:
    return self.num_codes

  def setup(self) -> None:
    table = lambda name, levels: self.param(name, NORMAL, (levels, self.num_codes + 1, self.code_dim))
    steps = self.num_levels - 1
    if self.shared_tables:
      shared = table("shared_tables", steps - 1)
      self.tables_in = jnp.concatenate([table("first_table", 1), shared])
      self.tables_out = jnp.concatenate([shared, table("last_table", 1)])
    else:
      self.tables_in, self.tables_out = table("tables_in", steps), table("tables_out", steps)
      self.bias_out = self.param("bias_out", nn.initializers.zeros, (self.num_levels, self.num_codes + 1))
    self.level_in = Dense(self.width, kernel_init=NORMAL, dtype=self.dtype)
    self.trunk = CodeTrunk(self.width, self.depth, self.num_heads, self.ff_width, self.dropout, self.dtype)
    self.head = CodeHead(self.code_dim, self.dtype)

  def embed(self, codes: Int[Array, "b l"], level: int | Int[Array, ""]) -> Float[Array, "b l c"]:
    """Embeds codes (B, L) of one level, 0 .. Q - 2, for the sum of `history`."""
    return self.tables_in[level][codes]

  def history(self, codes: Int[Array, "b l q"], level: Int[Array, " b"]) -> Float[Array, "b l c"]:
    """The sum of the embedded codes (B, L, Q) of all levels below `level` (B,)."""
    rows = self.tables_in[jnp.arange(self.num_levels - 1), codes[..., :self.num_levels - 1]]  # (B, L, Q - 1, C)
    below = jnp.arange(self.num_levels - 1) < level[:, None]
    return jnp.where(below[:, None, :, None], rows, 0.0).sum(-2)

  def __call__(self, history: Float[Array, "b l c"], level: Int[Array, " b"], text_emb: Float[Array, "b e"],
               real_mask: Bool[Array, "b l"], items: Int[Array, " b"] | None = None) -> Float[Array, "b l k"]:
    lead = self.level_in(jax.nn.one_hot(level, self.num_levels, dtype=self.dtype))
    hidden = self.head(self.trunk(history, text_emb, real_mask, items, lead))
    logits = jnp.einsum("blc,bkc->blk", hidden, self.tables_out[level - 1].astype(hidden.dtype))
    if self.shared_tables:
      return logits
    # Parity: the code adds the product to itself before the bias; only the level's row of the bias is used.
    return 2 * logits + self.bias_out[level - 1][:, None].astype(hidden.dtype)
