"""MAC-VAE of CMDM: features to causal latents and back (docs/papers/cmdm.md#tokenizer).

Latent j depends exactly on frames <= 4 j + 3 and frame f on latents <= f // 4: all convolutions are causal.

Parity: the paper counts 7 causal convolutions and 2 residual blocks in each half; these are the code's layers, whose
parameters are those of the released weights.
"""
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.convs import (
  Contexts,
  apply_layers,
  doubling_layers,
  halving_layers,
  init_contexts,
  run_layers,
  uniform_fan_in,
)
from motion_jax.nets.layers import Dense
from motion_jax.shapes import Array, Float

Gaussian = tuple[Float[Array, "b l c"], Float[Array, "b l c"]]  # mean and log-variance of latents


class Encoder(nn.Module):
  """x (B, T, F) -> (B, T // 2**num_halvings, 2 C): mean and log-variance side by side."""
  features: int
  latent_dim: int
  width: int
  num_halvings: int
  dilations: tuple[int, ...]
  dtype: Any
  causal: bool = True

  def setup(self) -> None:
    width = self.width
    # The last of them, conv_out, is W_enc of the alignment weight.
    self.layers = halving_layers(self.features, width, width, self.num_halvings, self.dilations, self.dtype,
                                 self.causal)
    init = uniform_fan_in(width)
    self.head = Dense(2 * self.latent_dim, kernel_init=init, bias_init=init, dtype=self.dtype)

  def init_state(self, batch: int) -> Contexts:
    return init_contexts(self.layers, batch)

  def step(self, x: Float[Array, "b n f"], state: Contexts) -> tuple[Float[Array, "b l c2"], Contexts]:
    x, state = run_layers(self.layers, x, state)
    return self.head(x), state

  def __call__(self, x: Float[Array, "b t f"]) -> Float[Array, "b l c2"]:
    return self.head(apply_layers(self.layers, x))


class Decoder(nn.Module):
  """z (B, N, C) -> (B, 2**num_halvings N, F)."""
  features: int
  latent_dim: int
  width: int
  num_halvings: int
  dilations: tuple[int, ...]
  dtype: Any
  causal: bool = True

  def setup(self) -> None:
    width = self.width
    init = uniform_fan_in(self.latent_dim)
    self.head = Dense(width, kernel_init=init, bias_init=init, dtype=self.dtype)
    self.layers = doubling_layers(width, width, self.features, self.num_halvings, self.dilations, self.dtype,
                                  self.causal)

  def init_state(self, batch: int) -> Contexts:
    return init_contexts(self.layers, batch)

  def step(self, z: Float[Array, "b l c"], state: Contexts) -> tuple[Float[Array, "b n f"], Contexts]:
    return run_layers(self.layers, self.head(z), state)

  def __call__(self, z: Float[Array, "b l c"]) -> Float[Array, "b t f"]:
    return apply_layers(self.layers, self.head(z))


class CausalVAE(nn.Module):
  """Causal autoencoder: x (B, T, F) normalized features <-> z (B, N, C), N = T // 2**num_halvings.

  `encode` gives mean and log-variance, `decode` features; `encode_step` and `decode_step` give the same for the next
  chunk of a stream, starting from `init_encode_state(batch)` or `init_decode_state(batch)`. Chunks may have any size
  (for encoding: multiples of 2**num_halvings frames). causal=False: the plain VAE of the paper's Table 4, which also
  sees later frames and cannot stream.
  """
  features: int = 263
  latent_dim: int = 64
  width: int = 1024
  num_halvings: int = 2
  dilations: Sequence[int] = (9, 3, 1)  # in this order in both halves
  teacher_dim: int = 0                    # 256 adds the alignment projection (training only)
  teacher_to_latent: bool = False         # project the teacher's features into latent space, not latents into theirs
  causal: bool = True
  decoder_width: int = 0                  # of the decoder, if it differs from that of the encoder
  dtype: Any = jnp.float32

  def setup(self) -> None:
    sizes: dict[str, Any] = dict(
        features=self.features, latent_dim=self.latent_dim, width=self.width, num_halvings=self.num_halvings,
        dilations=tuple(self.dilations), dtype=self.dtype, causal=self.causal)
    self.encoder = Encoder(**sizes)
    self.decoder = Decoder(**sizes | dict(width=self.decoder_width or self.width))
    if self.teacher_dim:
      fan_in, out = self.latent_dim, self.teacher_dim
      if self.teacher_to_latent:
        fan_in, out = out, fan_in
      init = uniform_fan_in(fan_in)
      self.align = Dense(out, kernel_init=init, bias_init=init, dtype=self.dtype)

  @property
  def frames_per_latent(self) -> int:
    return 2 ** self.num_halvings

  def init_encode_state(self, batch: int) -> Contexts:
    self._check_causal()
    return self.encoder.init_state(batch)

  def init_decode_state(self, batch: int) -> Contexts:
    self._check_causal()
    return self.decoder.init_state(batch)

  def encode_step(self, x: Float[Array, "b n f"], state: Contexts) -> tuple[Gaussian, Contexts]:
    """-> ((mean, logvar) (B, n // frames_per_latent, C) each, state); the log-variance is clipped to [-30, 20]."""
    y, state = self.encoder.step(x, state)
    return _mean_logvar(y), state

  def decode_step(self, z: Float[Array, "b l c"], state: Contexts) -> tuple[Float[Array, "b n f"], Contexts]:
    """-> (features (B, frames_per_latent n, F), state)."""
    return self.decoder.step(z, state)

  def encode(self, x: Float[Array, "b t f"]) -> Gaussian:
    if x.shape[1] < self.frames_per_latent:
      raise ValueError(f"got {x.shape[1]} frames, one latent needs {self.frames_per_latent}")
    return _mean_logvar(self.encoder(x))

  def decode(self, z: Float[Array, "b l c"]) -> Float[Array, "b t f"]:
    return self.decoder(z)

  def aligned(self, z: Float[Array, "b l c"], teacher: Float[Array, "b l e"]
              ) -> tuple[Float[Array, "b l a"], Float[Array, "b l a"]]:
    """Latents and the teacher's features, both (B, N, ...), projected to the space of the alignment loss."""
    return (z, self.align(teacher)) if self.teacher_to_latent else (self.align(z), teacher)

  def project(self, z: Float[Array, "b l c"]) -> Float[Array, "b l e"]:
    """Latents projected to the teacher's feature space, (B, N, teacher_dim)."""
    return self.align(z)

  def _check_causal(self) -> None:
    if not self.causal:
      raise ValueError("this tokenizer looks ahead (causal=False), so nothing can be streamed through it; train one "
                       "with model.causal=True")

  def __call__(self, x: Float[Array, "b t f"], noise: Float[Array, "b l c"]
               ) -> tuple[Float[Array, "b t2 f"], Float[Array, "b l c"], Float[Array, "b l c"]]:
    """noise (B, N, C) -> (reconstruction, mean, logvar); the latent used is mean + exp(logvar / 2) noise."""
    mean, logvar = self.encode(x)
    z = sample_latent(mean, logvar, noise)
    if self.teacher_dim and self.is_initializing():
      self.aligned(z, jnp.zeros(z.shape[:-1] + (self.teacher_dim,)))
    return self.decode(z), mean, logvar


def sample_latent(mean: Float[Array, "*lead c"], logvar: Float[Array, "*lead c"], noise: Float[Array, "*lead c"]
                  ) -> Float[Array, "*lead c"]:
  """Reparameterization: mean + exp(logvar / 2) noise."""
  return mean + jnp.exp(logvar / 2) * noise


def _mean_logvar(y: Float[Array, "*lead c2"]) -> tuple[Float[Array, "*lead c"], Float[Array, "*lead c"]]:
  """The two halves of the encoder's output; the log-variance is clipped to [-30, 20]."""
  mean, logvar = jnp.split(y, 2, axis=-1)
  return mean, jnp.clip(logvar, -30, 20)
