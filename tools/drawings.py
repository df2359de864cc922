"""Drawings of docs/papers: networks, masks and schedules of both papers, from the shapes of the code itself.

`python tools/build_docs.py` writes them.
"""
import pathlib

import jax
import jax.numpy as jnp

from motion_jax import draw
from motion_jax.diffusion import staircase
from motion_jax.models.cdamd.stages import make_generator
from motion_jax.nets import (
  Autoencoder,
  CausalDiT,
  CausalVAE,
  block_causal_mask,
  dual_causal_mask,
  known_or_past_mask,
  sliding_mask,
)
from motion_jax.utils import config_files
from motion_jax.utils.config_files import module_fields

OUT = pathlib.Path(__file__).parents[1] / "docs" / "papers" / "drawings"
FRAMES = 192  # 48 latents


def _array(*shape, dtype=jnp.float32):
  return jax.ShapeDtypeStruct(shape, dtype)


def _cmdm():
  config = config_files.load("cmdm_denoiser")
  vae, dit = CausalVAE(**module_fields(config.tokenizer)), CausalDiT(**module_fields(config.model))
  length = FRAMES // vae.frames_per_latent
  yield "cmdm-vae", draw.network(vae, _array(1, FRAMES, vae.features), _array(1, length, vae.latent_dim),
                                 title="CMDM's tokenizer: CausalVAE")
  yield "cmdm-dit", draw.network(
      dit, _array(1, length, dit.latent_dim), _array(1, length), _array(1, 20, dit.text_dim),
      _array(1, 1, length, length, dtype=bool), _array(1, 20, dtype=bool), title="CMDM's denoiser: CausalDiT")
  block = dit.block
  yield "cmdm-mask", draw.mask(block_causal_mask(4 * block, block), f"Training: block-causal, blocks of {block}")
  yield "cmdm-sliding", draw.mask(sliding_mask(6 * block, block, 3 * block), "A stream: three blocks of context")
  for name, lag, title in (("full", 0, "All at once: lag 0"), ("fss", 2, "Frame-wise: lag 2"),
                           ("ar", 8, "Block after block: lag 8")):
    yield f"cmdm-{name}", draw.schedule(staircase(8, 4 * block, lag, block), title)


def _cdamd():
  config = config_files.load("cdamd_generator")
  autoencoder = Autoencoder(**module_fields(config.tokenizer))
  generator, length = make_generator(config.model), FRAMES // autoencoder.frames_per_latent
  network, width = generator.transformer, generator.head.latent_dim
  yield "cdamd-autoencoder", draw.network(autoencoder, _array(1, FRAMES, autoencoder.features),
                                          title="CDAMD's autoencoder")
  latents, words, mask = _array(1, length, width), _array(1, 1, network.text_dim), _array(
      1, 1, length, length, dtype=bool)
  yield "cdamd-transformer", draw.network(network, latents, words, mask, title="CDAMD's transformer")
  yield "cdamd-head", draw.network(generator.head, _array(length, width), _array(length),
                                   _array(length, network.width), title="CDAMD's diffusion head")
  known = jnp.arange(12)[None] % 2 == 0
  yield "cdamd-dccm", draw.mask(dual_causal_mask(known), "Dual-constrained, every second known")
  yield "cdamd-bcm", draw.mask(known_or_past_mask(known), "Known or past, every second known")


def drawings():
  """{file name: the drawing} of all that docs/papers shows."""
  return {f"{name}.svg": svg + "\n" for paper in (_cmdm, _cdamd) for name, svg in paper()}
