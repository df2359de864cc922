"""Tokenizer round trips for evaluations: padded motions, encoded and decoded.

A method lists its tokenizers by stage in `TOKENIZERS` of its model.py, those inside of its generators among them; the
functions here are for networks that methods share.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from ml_collections import ConfigDict

from motion_jax.latents import AutoencoderCodec, RvqCodec, VaeCodec
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.shapes import Array


class RoundTrip(NamedTuple):
  """The encoder and decoder of a tokenizer as one function, for evaluations.

  shapes: of its parameters. run(params, x (B, T, F), num_frames (B,), keys (B,) or None) -> (B, T, F): normalized
  features, encoded and decoded; keys draw the latents of a variational tokenizer, None takes their means.
  """
  shapes: Any
  run: Callable[[Any, Array, Array, Any], Array]


def causal_vae(fields: dict[str, Any], config: ConfigDict) -> RoundTrip:
  """Of a `nets.CausalVAE` with these fields."""
  net = CausalVAE(**fields)
  x = jax.ShapeDtypeStruct((1, net.frames_per_latent, net.features), "float32")
  noise = jax.ShapeDtypeStruct((1, 1, net.latent_dim), "float32")
  # Parity: the released evaluation draws latents; rows of padding are encoded and decoded like all others.
  return RoundTrip(jax.eval_shape(net.init, jax.random.key(0), x, noise),
                   lambda params, x, num_frames, keys: VaeCodec(net, params).reconstruct(x, keys))


def autoencoder(fields: dict[str, Any], config: ConfigDict) -> RoundTrip:
  """Of a `nets.Autoencoder` with continuous latents."""
  from motion_jax.models.shared.autoencoders import autoencoder_shapes
  from motion_jax.nets.autoencoder import Autoencoder
  net = Autoencoder(**fields)
  unit = net.frames_per_latent

  def run(params, x, num_frames, keys):
    return AutoencoderCodec(net, params).reconstruct(x, padding_mask(num_frames, x.shape[1]),
                                                     padding_mask(num_frames // unit, x.shape[1] // unit))
  return RoundTrip(autoencoder_shapes(net), run)


def rvq(fields: dict[str, Any], config: ConfigDict) -> RoundTrip:
  """Of an RVQ-VAE: a `nets.Autoencoder` with the codebooks of config.quantizer."""
  from motion_jax.models.shared.autoencoders import autoencoder_shapes
  from motion_jax.nets.autoencoder import Autoencoder
  net = Autoencoder(**fields)
  return RoundTrip(autoencoder_shapes(net, config.quantizer), lambda params, x, num_frames, keys: RvqCodec(
      net, params).reconstruct(x, padding_mask(num_frames, x.shape[1])))
