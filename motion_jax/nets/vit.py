"""Vision transformer (ViT): pre-norm blocks over patches, a class token, learned positions."""
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.attention import Attention
from motion_jax.nets.post_norm import ACTIVATIONS
from motion_jax.shapes import Array, Float


class ViTBlock(nn.Module):
  """x + attention(norm(x)), then x + mlp(norm(x)): (B, N, D) -> (B, N, D). No dropout."""
  num_heads: int
  mlp_width: int
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b n d"]) -> Float[Array, "b n d"]:
    norm = lambda name: nn.LayerNorm(epsilon=1e-6, dtype=self.dtype, use_fast_variance=False, name=name)
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, name=name)
    x = x + Attention(x.shape[-1], self.num_heads, self.dtype, normalize=False, name="attn")(norm("attn_norm")(x))
    y = ACTIVATIONS["gelu"](dense(self.mlp_width, "mlp_in")(norm("mlp_norm")(x)))
    return x + dense(x.shape[-1], "mlp_out")(y)


class ViT(nn.Module):
  """Patches (B, N, P) of an image -> tokens (B, 1 + N, D) of the last block, class token first, not normalized."""
  width: int = 768
  depth: int = 12
  num_heads: int = 12
  mlp_width: int = 3072
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, patches: Float[Array, "b n p"]) -> Float[Array, "b n+1 d"]:
    x = nn.Dense(self.width, dtype=self.dtype, name="patch_embed")(patches)
    token = self.param("token", nn.initializers.normal(0.02), (self.width,)).astype(self.dtype)
    positions = self.param("positions", nn.initializers.normal(0.02), (1 + patches.shape[1], self.width))
    x = jnp.concatenate([jnp.broadcast_to(token, x[:, :1].shape), x], axis=1) + positions.astype(self.dtype)
    for i in range(self.depth):
      x = ViTBlock(self.num_heads, self.mlp_width, self.dtype, name=f"block{i}")(x)
    return x


def resize_positions(table: Float[Array, "n d"], grid: tuple[int, int], new_grid: tuple[int, int]
                     ) -> Float[Array, "m d"]:
  """Resizes a table of learned positions (1 + h w, D), class row first, from a grid (h, w) of patches to another.

  The grid is resized as an image, by a bicubic filter (Keys, a = -1/2) that is widened where the new grid is coarser,
  as timm does with ImageNet weights (docs/papers/cmdm.md#motionpatches). The class row is unchanged.
  """
  if table.shape[0] != 1 + grid[0] * grid[1]:
    raise ValueError(f"got a table of {table.shape[0]} positions for a grid of {grid[0]} x {grid[1]} patches, expected "
                     f"{1 + grid[0] * grid[1]}")
  image = jnp.asarray(table[1:]).reshape(*grid, -1)
  resized = jax.image.resize(image, (*new_grid, image.shape[-1]), "bicubic", antialias=True)
  return jnp.concatenate([jnp.asarray(table[:1]), resized.reshape(-1, image.shape[-1])])
