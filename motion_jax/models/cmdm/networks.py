"""CMDM's networks with their weights, compiled: the base of generation, multi-prompt motion and streams."""
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Num

from motion_jax.latents import VaeCodec
from motion_jax.models import cmdm
from motion_jax.models.base import TextToMotionModel
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.runs import Run
from motion_jax.shapes import Array
from motion_jax.text.contrast import Contrast, contrasted
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields


class Compiled(NamedTuple):
  """The functions of `cmdm` that a model runs, compiled on first use for each new shape."""
  generate: Callable
  generate_whole: Callable
  chain_segment: Callable
  extend: Callable
  stream_start: Callable
  stream_words: Callable
  stream_control: Callable
  stream_step: Callable
  encode: Callable
  decode: Callable


def _compile(dit: CausalDiT) -> Compiled:
  program = lambda fn, num_static, *modules: cache.Program(fn.__name__, partial(fn, *modules), num_static, modules)
  return Compiled(
      generate=program(cmdm.generate, 2, dit), generate_whole=program(cmdm.generate_whole, 2, dit),
      chain_segment=program(cmdm.chain_segment, 2, dit), extend=program(cmdm.extend, 2, dit),
      stream_start=program(cmdm.stream_start, 1, dit), stream_words=program(cmdm.stream_words, 1, dit),
      stream_control=program(cmdm.stream_control, 0, dit), stream_step=program(cmdm.stream_step, 2),
      encode=program(VaeCodec.encode, 0), decode=program(VaeCodec.decode, 0))


class CmdmNetworks(TextToMotionModel):
  """A trained denoiser with its tokenizer and text encoder, each compiled on first use."""

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), data__max_words=(1, 10_000),
                      sampler__num_steps=(1, 10_000), sampler__lag=(1, 10_000), sampler__guidance_scale=(-1e3, 1e3))
    self.vae = CausalVAE(**module_fields(config.tokenizer))
    self.dit = CausalDiT(**module_fields(config.model))
    super().__init__(run, encoder, self.dit.text_dim, self.vae.frames_per_latent,
                     cache.kept_shapes("cmdm.frozen", self.vae, lambda: cmdm.frozen_shapes(self.vae)),
                     cache.kept_shapes("cmdm.denoiser", self.dit, lambda: cmdm.denoiser_shapes(self.dit)))
    self.codec = VaeCodec.of(self.vae, self.frozen)
    self.context = config.data.max_frames // self.vae.frames_per_latent // self.dit.block * self.dit.block
    self.compiled = _compile(self.dit)

  def reconstruct(self, features: Num[Array, "t f"]) -> Float[np.ndarray, "_ f"]:
    """Features (T, F) through the tokenizer and back, T cut to whole latents."""
    whole = len(features) // self.frames_per_latent * self.frames_per_latent
    x = self.stats.normalize(np.asarray(features))[None, :whole]
    return self.stats.denormalize(np.asarray(self.codec.reconstruct(jnp.asarray(x))))[0]

  def encode_words(self, prompts: Sequence[str], contrast: Contrast | None = None
                   ) -> tuple[Float[np.ndarray, "b s e"], Bool[np.ndarray, "b s"]]:
    """(text_emb, text_mask) of prompts, padded to the width of everyday ones so that these share compiled code.

    Longer ones are padded to twice that, four times, ...: each width is compiled once. contrast: see `text.contrast`.
    """
    everyday = -(-self.config.data.max_words // 8) * 8
    emb, mask = self.encoder(prompts, at_least=everyday)
    if contrast is not None and contrast.scale:
      emb = contrasted(self.encoder, prompts, emb, mask, contrast)
    missing = max(everyday - emb.shape[1], 0)  # of a sentence vector, which is one row
    return np.pad(emb, ((0, 0), (0, missing), (0, 0))), np.pad(mask, ((0, 0), (0, missing)))
