"""Autoencoder of CDAMD and MARDM: features to latents and back, by convolutions that are not causal.

Source: docs/papers/cdamd.md#autoencoder.

CDAMD's RVQ-VAE has the same layers, trained separately, and quantizes the latents between encoder and decoder.
"""
from collections.abc import Callable, Sequence
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.convs import apply_layers, doubling_layers, halving_layers
from motion_jax.shapes import Array, Bool, Float, Int


class ConvStack(nn.Module):
  """Encoder or decoder of an autoencoder: the layers that `make(features, width, out, ...)` lists, in sequence."""
  make: Callable  # halving_layers or doubling_layers
  features: int
  width: int
  out: int
  num_halvings: int
  dilations: tuple[int, ...]
  dropout: float
  dtype: Any

  def setup(self) -> None:
    self.layers = self.make(self.features, self.width, self.out, self.num_halvings, self.dilations, self.dtype,
                            causal=False, dropout=self.dropout)

  def __call__(self, x: Float[Array, "b t f"], items: Int[Array, " b"] | None = None,
               real_mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b l c"]:
    return apply_layers(self.layers, x, items, real_mask)


class Autoencoder(nn.Module):
  """Deterministic autoencoder: x (B, T, F) normalized features <-> z (B, N, C), N = T // 2**num_halvings.

  items (B,), places in the whole batch, switch on the dropout of the residual branches, which needs
  rngs={"dropout": key}. Latents are not normalized. Frames past the last whole latent are not encoded.

  hide_padding: with a real_mask, (B, T) of frames or (B, N) of latents, a clip is encoded and decoded as if it ended
  where its padding begins. Without, the network sees padding as motion: after training on windows, which have none, the
  end of a padded clip is reconstructed far worse than its middle.
  """
  # Parity: the reference hides padding neither from its encoder nor from its decoder, which gets zero latents there.
  # Parity: the paper says "3-layer"; these are the code's 2 halvings with 3 residual blocks each.
  features: int = 66
  latent_dim: int = 512
  width: int = 512
  num_halvings: int = 2
  dilations: Sequence[int] = (9, 3, 1)  # in this order in both halves
  dropout: float = 0.2
  dtype: Any = jnp.float32
  hide_padding: bool = False
  decoder_width: int = 0  # of the decoder, if it differs from that of the encoder

  def setup(self) -> None:
    sizes = dict(width=self.width, num_halvings=self.num_halvings, dilations=tuple(self.dilations),
                 dropout=self.dropout, dtype=self.dtype)
    self.encoder = ConvStack(halving_layers, features=self.features, out=self.latent_dim, **sizes)
    self.decoder = ConvStack(doubling_layers, features=self.latent_dim, out=self.features,
                             **sizes | dict(width=self.decoder_width or self.width))

  @property
  def frames_per_latent(self) -> int:
    return 2 ** self.num_halvings

  def encode(self, x: Float[Array, "b t f"], items: Int[Array, " b"] | None = None,
             real_mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b l c"]:
    if x.shape[1] < self.frames_per_latent:
      raise ValueError(f"got {x.shape[1]} frames, one latent needs {self.frames_per_latent}")
    return self.encoder(x, items, real_mask if self.hide_padding else None)

  def decode(self, z: Float[Array, "b l c"], items: Int[Array, " b"] | None = None,
             real_mask: Bool[Array, "b l"] | None = None) -> Float[Array, "b t f"]:
    """-> features (B, frames_per_latent N, F)."""
    return self.decoder(z, items, real_mask if self.hide_padding else None)

  def __call__(self, x: Float[Array, "b t f"], items: Int[Array, " b"] | None = None) -> Float[Array, "b t2 f"]:
    return self.decode(self.encode(x, items), items)
