"""A critic of motion for adversarial losses: temporal convolutions on how joints move, at several frame rates."""
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.shapes import Array, Float


class MotionCritic(nn.Module):
  """Scores of windows of motion, high for real ones, by one tower of convolutions for each stride.

  Weight-normalized, as in the critics of neural audio codecs (SoundStream, arXiv 2107.03312).
  """
  width: int = 64
  strides: Sequence[int] = (1, 2, 4)
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b t n"]) -> list[list[Float[Array, "b _ _"]]]:
    """x (B, T, N) -> for each stride the outputs of its layers, of which the last are the scores (B, t, 1)."""
    towers = []
    for stride in self.strides:
      y = nn.avg_pool(x, (stride,), (stride,)) if stride > 1 else x
      layers = []
      for i, (times, step) in enumerate(((1, 1), (1, 2), (2, 2), (2, 1))):
        conv = nn.Conv(times * self.width, (5,), (step,), dtype=self.dtype, name=f"stride{stride}_{i}")
        y = nn.leaky_relu(nn.WeightNorm(conv, name=f"norm{stride}_{i}")(y), 0.2)
        layers.append(y)
      out = nn.Conv(1, (3,), dtype=self.dtype, name=f"stride{stride}_out")
      towers.append([*layers, nn.WeightNorm(out, name=f"norm{stride}_out")(y)])
    return towers
