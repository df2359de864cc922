"""MARDM's length estimator: a distribution of motion lengths for a sentence (docs/papers/cdamd.md#length)."""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.shapes import Array, Float

NORMAL = nn.initializers.normal(0.02)


class LengthEstimator(nn.Module):
  """text (B, W) sentence vectors -> logits (B, num_classes); class k stands for k latents."""
  num_classes: int = 50
  width: int = 512
  dropout: float = 0.2
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, text: Float[Array, "b w"], deterministic: bool = True) -> Float[Array, "b classes"]:
    x = text
    for i in range(3):
      x = nn.Dense(self.width >> i, kernel_init=NORMAL, dtype=self.dtype, name=f"layer{i}")(x)
      x = nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name=f"norm{i}")(x)
      x = nn.leaky_relu(x, 0.2)
      if i < 2:
        x = nn.Dropout(self.dropout, deterministic=deterministic)(x)
    return nn.Dense(self.num_classes, kernel_init=NORMAL, dtype=self.dtype, name="out")(x)
