"""MAC-VAE of CMDM: features to causal latents and back (facts: cmdm 2.1).

Latent j depends on frames <= 4 j + 3 and frame f on latents <= f // 4, exactly: all convolutions look left only.

Parity: the paper counts 7 causal convolutions and 2 residual blocks in each half; these are the code's layers, whose
parameters are those of the released weights.
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.convs import (
  CausalConv,
  ResBlock,
  init_contexts,
  relu_step,
  run_layers,
  uniform_fan_in,
  upsample_step,
)


def _stack(width, dilations, dtype, name):
  return [ResBlock(width, dilation, dtype, name=f"{name}_block{b}") for b, dilation in enumerate(dilations)]


class Encoder(nn.Module):
  """x (B, T, F) -> (B, T // 2**num_halvings, 2 C): mean and log-variance side by side."""
  features: int
  latent_dim: int
  width: int
  num_halvings: int
  dilations: tuple[int, ...]
  dtype: Any

  def setup(self):
    width = self.width
    layers = [CausalConv(self.features, width, 3, dtype=self.dtype, name="conv_in"), relu_step]
    for i in range(self.num_halvings):
      layers += [CausalConv(width, width, 4, stride=2, dtype=self.dtype, name=f"down{i}")]
      layers += _stack(width, self.dilations, self.dtype, f"stack{i}")
    layers += [CausalConv(width, width, 3, dtype=self.dtype, name="conv_out")]  # W_enc of the alignment weight
    self.layers = layers
    init = uniform_fan_in(width)
    self.head = nn.Dense(2 * self.latent_dim, kernel_init=init, bias_init=init, dtype=self.dtype)

  def init_state(self, batch):
    return init_contexts(self.layers, batch)

  def step(self, x, state):
    x, state = run_layers(self.layers, x, state)
    return self.head(x), state


class Decoder(nn.Module):
  """z (B, N, C) -> (B, 2**num_halvings N, F)."""
  features: int
  latent_dim: int
  width: int
  num_halvings: int
  dilations: tuple[int, ...]
  dtype: Any

  def setup(self):
    width = self.width
    init = uniform_fan_in(self.latent_dim)
    self.head = nn.Dense(width, kernel_init=init, bias_init=init, dtype=self.dtype)
    layers = [CausalConv(width, width, 3, dtype=self.dtype, name="conv_in"), relu_step]
    for i in range(self.num_halvings):
      layers += _stack(width, self.dilations, self.dtype, f"stack{i}")
      layers += [upsample_step, CausalConv(width, width, 3, dtype=self.dtype, name=f"up{i}")]
    layers += [CausalConv(width, width, 3, dtype=self.dtype, name="conv_mid"), relu_step,
               CausalConv(width, self.features, 3, dtype=self.dtype, name="conv_out")]
    self.layers = layers

  def init_state(self, batch):
    return init_contexts(self.layers, batch)

  def step(self, z, state):
    return run_layers(self.layers, self.head(z), state)


class CausalVAE(nn.Module):
  """Causal autoencoder: x (B, T, F) normalized features <-> z (B, N, C), N = T // 2**num_halvings.

  `encode` gives mean and log-variance, `decode` features; `*_step` do the same to the next chunk of a stream, from the
  state of `init_*_state(batch)`, whatever the chunk sizes (for encoding: multiples of 2**num_halvings frames).
  """
  features: int = 263
  latent_dim: int = 64
  width: int = 1024
  num_halvings: int = 2
  dilations: tuple[int, ...] = (9, 3, 1)  # in this order in both halves
  teacher_dim: int = 0                    # 256 adds the alignment projection (training only)
  dtype: Any = jnp.float32

  def setup(self):
    sizes = dict(features=self.features, latent_dim=self.latent_dim, width=self.width, num_halvings=self.num_halvings,
                 dilations=tuple(self.dilations), dtype=self.dtype)
    self.encoder = Encoder(**sizes)
    self.decoder = Decoder(**sizes)
    if self.teacher_dim:
      init = uniform_fan_in(self.latent_dim)
      self.align = nn.Dense(self.teacher_dim, kernel_init=init, bias_init=init, dtype=self.dtype)

  @property
  def frames_per_latent(self) -> int:
    return 2 ** self.num_halvings

  def init_encode_state(self, batch):
    return self.encoder.init_state(batch)

  def init_decode_state(self, batch):
    return self.decoder.init_state(batch)

  def encode_step(self, x, state):
    """-> ((mean, logvar) (B, n // frames_per_latent, C) each, state); the log-variance is clipped to [-30, 20]."""
    y, state = self.encoder.step(x, state)
    mean, logvar = jnp.split(y, 2, axis=-1)
    return (mean, jnp.clip(logvar, -30, 20)), state

  def decode_step(self, z, state):
    """-> (features (B, frames_per_latent n, F), state)."""
    return self.decoder.step(z, state)

  def encode(self, x):
    if x.shape[1] < self.frames_per_latent:
      raise ValueError(f"got {x.shape[1]} frames, one latent needs {self.frames_per_latent}")
    return self.encode_step(x, self.init_encode_state(x.shape[0]))[0]

  def decode(self, z):
    return self.decode_step(z, self.init_decode_state(z.shape[0]))[0]

  def project(self, z):
    """Latents as the teacher would see them, (B, N, teacher_dim)."""
    return self.align(z)

  def __call__(self, x, noise):
    """noise (B, N, C) -> (reconstruction, mean, logvar); the latent used is mean + exp(logvar / 2) noise."""
    mean, logvar = self.encode(x)
    z = sample_latent(mean, logvar, noise)
    if self.teacher_dim and self.is_initializing():
      self.project(z)
    return self.decode(z), mean, logvar


def sample_latent(mean, logvar, noise):
  """Reparameterisation: a draw from the normal distribution that the encoder names."""
  return mean + jnp.exp(logvar / 2) * noise
