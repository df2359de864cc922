"""A gated recurrent unit with PyTorch's equations."""
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.convs import uniform_fan_in
from motion_jax.shapes import Array, Bool, Float


class GRU(nn.Module):
  """A GRU in one direction: x (B, L, W), first state h (B, H), real_mask (B, L) or None -> states (B, L, H).

  Padding leaves the state unchanged, so the last state of a padded sequence is that of its last real step (of its
  first, with reverse). Gates are in the order reset, update, new; the reset gate is applied after the hidden bias.
  """
  width: int
  reverse: bool = False
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b l w"], h: Float[Array, "b h"], real_mask: Bool[Array, "b l"] | None = None
               ) -> Float[Array, "b l h"]:
    init = uniform_fan_in(self.width)
    weight = lambda name, *shape: self.param(name, init, shape).astype(self.dtype)
    w_in, b_in = weight("w_in", x.shape[-1], 3 * self.width), weight("b_in", 3 * self.width)
    w_hidden, b_hidden = weight("w_hidden", self.width, 3 * self.width), weight("b_hidden", 3 * self.width)
    real_mask = jnp.ones(x.shape[:2], bool) if real_mask is None else real_mask

    def step(h, inputs):
      given, real = inputs
      reset_in, update_in, new_in = jnp.split(given, 3, axis=-1)
      reset_h, update_h, new_h = jnp.split(h @ w_hidden + b_hidden, 3, axis=-1)
      update = nn.sigmoid(update_in + update_h)
      new = jnp.tanh(new_in + nn.sigmoid(reset_in + reset_h) * new_h)
      h = jnp.where(real[:, None], (1 - update) * new + update * h, h)
      return h, h

    steps = (x.astype(self.dtype) @ w_in + b_in).swapaxes(0, 1), real_mask.T
    return jax.lax.scan(step, h, steps, reverse=self.reverse)[1].swapaxes(0, 1)
