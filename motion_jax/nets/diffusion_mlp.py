"""The diffusion head of one token: from noise to a latent, given the transformer's condition.

Source: docs/papers/cdamd.md#diffusion-mlp.

It knows no neighbours. The same network serves both ways of training: as a flow it gives the velocity at times in
[0, 1], as DDPM the noise at steps 0, 1, 2, ...
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int, Num

from motion_jax.nets.layers import Dense, layer_norm, promote_to_f32, timestep_embedding
from motion_jax.shapes import Array

XAVIER = nn.initializers.xavier_uniform()


class ResBlock(nn.Module):
  """Two layers on a modulated norm; x, y (..., D). As initialised it is the identity."""
  dtype: Any

  @nn.compact
  def __call__(self, x: Float[Array, "*lead d"], y: Float[Array, "*lead d"]) -> Float[Array, "*lead d"]:
    width = x.shape[-1]
    film = Dense(3 * width, ("embed", "film"), kernel_init=nn.initializers.zeros, dtype=self.dtype, name="film")(
        nn.silu(y))
    shift, scale, gate = jnp.split(film, 3, axis=-1)
    h = nn.LayerNorm(epsilon=1e-6, dtype=self.dtype, use_fast_variance=False, name="norm")(x) * (1 + scale) + shift
    h = nn.silu(Dense(width, ("embed", "mlp"), kernel_init=XAVIER, dtype=self.dtype, name="ff_in")(h))
    return x + gate * Dense(width, ("mlp", "embed"), kernel_init=XAVIER, dtype=self.dtype, name="ff_out")(h)


class DiffusionMLP(nn.Module):
  """x (..., C) noisy latents at t (...), condition (..., H) -> velocity or noise (..., C)."""
  latent_dim: int = 512
  width: int = 1792
  depth: int = 16
  dtype: Any = jnp.float32
  remat: bool = False  # a gradient computes what is inside of a block once more, instead of keeping it

  @nn.compact
  def __call__(self, x: Float[Array, "*lead c"], t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]
               ) -> Float[Array, "*lead c"]:
    dense = lambda size, name, *axes, init=XAVIER: Dense(size, axes, kernel_init=init, dtype=self.dtype, name=name)
    normal = nn.initializers.normal(0.02)
    # Parity: raw t in [0, 1] enters the sinusoids of the flow, not t * 1000.
    numbers = timestep_embedding(jnp.broadcast_to(t, x.shape[:-1]).astype(promote_to_f32(self.dtype)))
    level = dense(self.width, "time_out", "mlp", "embed", init=normal)(
        nn.silu(dense(self.width, "time_in", None, "mlp", init=normal)(numbers)))
    y = level + dense(self.width, "condition_in", None, "embed")(condition.astype(self.dtype))
    x = dense(self.width, "x_in", None, "embed")(x.astype(self.dtype))
    block = nn.remat(ResBlock) if self.remat else ResBlock
    for i in range(self.depth):
      x = block(self.dtype, name=f"block{i}")(x, y)
    film = dense(2 * self.width, "film", "embed", "film", init=nn.initializers.zeros)(nn.silu(y))
    shift, scale = jnp.split(film, 2, axis=-1)
    out = dense(self.latent_dim, "out", "embed", None, init=nn.initializers.zeros)
    return out(layer_norm(1e-6, self.dtype)(x) * (1 + scale) + shift)


class Generator(nn.Module):
  """A masked transformer and its diffusion head, as they are trained and saved together.

  transformer: a `MaskedTransformer` or `GatedTransformer`; head: a `DiffusionMLP`. `condition` is the one's call,
  `predict` the other's.
  """
  transformer: Any
  head: Any

  def condition(self, *args: Any, **named: Any) -> Float[Array, "b l h"]:
    return self.transformer(*args, **named)

  def predict(self, x: Float[Array, "*lead c"], t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]
              ) -> Float[Array, "*lead c"]:
    return self.head(x, t, condition)

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.transformer.mask_token()

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: Bool[Array, "#b 1 l l"],
               t: Num[Array, "*#lead"], codes: Int[Array, "b l *q"] | None = None) -> Float[Array, "b l c"]:
    """Touches every parameter, for init."""
    self.mask_token()
    return self.head(x, t, self.transformer(x, text_emb, attn_mask, codes))
