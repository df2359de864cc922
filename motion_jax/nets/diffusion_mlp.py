"""The diffusion head of one token: from noise to a latent, given the transformer's condition.

Source: docs/papers/cdamd.md#diffusion-mlp.

Each token is denoised alone, without attention. The same network serves both ways of training: as a flow it predicts
the velocity at times in [0, 1], as DDPM the noise at steps 0, 1, 2, ...
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.layers import Dense, layer_norm, promote_to_f32, timestep_embedding
from motion_jax.shapes import Array, AttentionMask, Float, Int, Num

XAVIER = nn.initializers.xavier_uniform()
# Not of the paper: heads of generators of about 1 and 3 billion parameters, for meshes (docs/pods.md).
LARGER_SIZES = {"1B": dict(width=2560, depth=24), "3B": dict(width=4096, depth=24)}


class ResBlock(nn.Module):
  """Residual block: two layers after a norm that y modulates; x, y (..., D). At initialization it is the identity."""
  width: int
  dtype: Any

  def setup(self) -> None:
    self.film = Dense(3 * self.width, ("embed", "film"), kernel_init=nn.initializers.zeros, dtype=self.dtype)
    self.norm = nn.LayerNorm(epsilon=1e-6, dtype=self.dtype, use_fast_variance=False)
    self.ff_in = Dense(self.width, ("embed", "mlp"), kernel_init=XAVIER, dtype=self.dtype)
    self.ff_out = Dense(self.width, ("mlp", "embed"), kernel_init=XAVIER, dtype=self.dtype)

  def modulation(self, y: Float[Array, "*lead d"]) -> Float[Array, "*lead e"]:
    """Shift, scale and gate, concatenated (..., 3 D); independent of x."""
    return self.film(nn.silu(y))

  def run(self, x: Float[Array, "*lead d"], modulation: Float[Array, "*#lead e"]) -> Float[Array, "*lead d"]:
    shift, scale, gate = jnp.split(modulation, 3, axis=-1)
    h = nn.silu(self.ff_in(self.norm(x) * (1 + scale) + shift))
    return x + gate * self.ff_out(h)

  def __call__(self, x: Float[Array, "*lead d"], y: Float[Array, "*#lead d"]) -> Float[Array, "*lead d"]:
    return self.run(x, self.modulation(y))


class DiffusionMLP(nn.Module):
  """x (..., C) noisy latents at t (...), condition (..., H) -> velocity or noise (..., C).

  `modulation` depends on t and condition alone and holds three fifths of the parameters; a solver can compute it for
  several times together. `run` is the rest.
  """
  latent_dim: int = 512
  width: int = 1792
  depth: int = 16
  dtype: Any = jnp.float32
  remat: bool = False  # recompute each block in the backward pass instead of storing its activations

  def setup(self) -> None:
    dense = lambda size, *axes, init=XAVIER: Dense(size, axes, kernel_init=init, dtype=self.dtype)
    normal = nn.initializers.normal(0.02)
    self.time_in = dense(self.width, None, "mlp", init=normal)
    self.time_out = dense(self.width, "mlp", "embed", init=normal)
    self.condition_in, self.x_in = dense(self.width, None, "embed"), dense(self.width, None, "embed")
    block = nn.remat(ResBlock) if self.remat else ResBlock
    self.blocks = [block(self.width, self.dtype, name=f"block{i}") for i in range(self.depth)]
    self.film = dense(2 * self.width, "embed", "film", init=nn.initializers.zeros)
    self.out = dense(self.latent_dim, "embed", None, init=nn.initializers.zeros)
    self.norm = layer_norm(1e-6, self.dtype)

  def _level(self, t: Num[Array, "*lead"], condition: Float[Array, "*lead2 h"]) -> Float[Array, "*lead3 d"]:
    # Parity: raw t in [0, 1] enters the sinusoids of the flow, not t * 1000.
    numbers = timestep_embedding(jnp.asarray(t).astype(promote_to_f32(self.dtype)))
    return self.time_out(nn.silu(self.time_in(numbers))) + self.condition_in(condition.astype(self.dtype))

  def modulation(self, t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]) -> tuple[Array, ...]:
    """Modulation of each block (..., 3 D), and of the last layer (..., 2 D)."""
    y = self._level(t, condition)
    return (*(block.modulation(y) for block in self.blocks), self.film(nn.silu(y)))

  def run(self, x: Float[Array, "*lead c"], modulation: tuple[Array, ...]) -> Float[Array, "*lead c"]:
    """Velocity or noise (..., C) of x, given the result of `modulation`."""
    x = self.x_in(x.astype(self.dtype))
    for block, film in zip(self.blocks, modulation):
      x = block.run(x, film)
    return self._output(x, modulation[-1])

  def _output(self, x: Float[Array, "*lead d"], film: Float[Array, "*#lead e"]) -> Float[Array, "*lead c"]:
    shift, scale = jnp.split(film, 2, axis=-1)
    return self.out(self.norm(x) * (1 + scale) + shift)

  def __call__(self, x: Float[Array, "*lead c"], t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]
               ) -> Float[Array, "*lead c"]:
    y, x = self._level(t, condition), self.x_in(x.astype(self.dtype))
    for block in self.blocks:
      x = block(x, y)
    return self._output(x, self.film(nn.silu(y)))


class Generator(nn.Module):
  """A masked transformer and its diffusion head, trained and saved together.

  transformer: a `MaskedTransformer` or `GatedTransformer`; head: a `DiffusionMLP`. `condition` calls the transformer,
  `predict` the head; `text_state`, `window`, `modulation` and `run` are the same passes in parts.
  """
  transformer: Any
  head: Any

  def condition(self, *args: Any, **named: Any) -> Float[Array, "b l h"]:
    return self.transformer(*args, **named)

  def predict(self, x: Float[Array, "*lead c"], t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]
              ) -> Float[Array, "*lead c"]:
    return self.head(x, t, condition)

  def text_state(self, text_emb: Float[Array, "b s e"]) -> tuple[Any, ...]:
    return self.transformer.text_state(text_emb)

  def window(self, *args: Any, **named: Any) -> tuple[Float[Array, "b w h"], tuple[Any, ...]]:
    return self.transformer.window(*args, **named)

  def modulation(self, t: Num[Array, "*#lead"], condition: Float[Array, "*#lead h"]) -> tuple[Array, ...]:
    return self.head.modulation(t, condition)

  def run(self, x: Float[Array, "*lead c"], modulation: tuple[Array, ...]) -> Float[Array, "*lead c"]:
    return self.head.run(x, modulation)

  def mask_token(self) -> Float[Array, "1 1 c"]:
    return self.transformer.mask_token()

  def __call__(self, x: Float[Array, "b l c"], text_emb: Float[Array, "b s e"], attn_mask: AttentionMask,
               t: Num[Array, "*#lead"], codes: Int[Array, "b l *q"] | None = None) -> Float[Array, "b l c"]:
    """Touches every parameter, for init."""
    self.mask_token()
    return self.head(x, t, self.transformer(x, text_emb, attn_mask, codes))
