"""MLD's stack of post-norm layers with skip connections as in a U-Net (docs/papers/mld.md#skip-stack)."""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.post_norm import PostNormDecoderLayer, PostNormLayer
from motion_jax.shapes import Array, Bool, Float, Int


class SkipTransformer(nn.Module):
  """x (B, L, D) -> (B, L, D) by `depth` layers, an odd number, and a final norm.

  Outputs of the first half are concatenated, in reverse order, to inputs of the second: of 5 layers, down0, down1,
  middle, up0 (with down1's), up1 (with down0's). key_mask (B, L), True = may be attended to. memory (B, M, D): layers
  are then decoder layers, which also attend to it. items: see `PostNormLayer`.
  """
  depth: int = 9
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"], key_mask: Bool[Array, "b l"] | None = None,
               memory: Float[Array, "b m d"] | None = None, items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b l d"]:
    if self.depth % 2 == 0:
      raise ValueError(f"got {self.depth} layers with skip connections, expected an odd number")

    def layer(name, x):
      kind: Any = PostNormLayer if memory is None else PostNormDecoderLayer
      module = kind(self.num_heads, self.mlp_width, dropout=self.dropout, dtype=self.dtype, name=name)
      if memory is None:
        return module(x, key_mask, items=items)
      return module(x, memory, None if key_mask is None else key_mask[:, None, None, :], items=items)

    kept = []
    for i in range(self.depth // 2):
      x = layer(f"down{i}", x)
      kept.append(x)
    x = layer("middle", x)
    for i in range(self.depth // 2):
      x = jnp.concatenate([x, kept.pop()], axis=-1)
      x = layer(f"up{i}", nn.Dense(x.shape[-1] // 2, dtype=self.dtype, name=f"join{i}")(x))
    return nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name="norm")(x)
