"""Tokenizers of any run, alone or inside a generator's: motion to latents and back."""
import dataclasses
import pathlib
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import runs
from motion_jax.latents import TOKENIZER, AutoencoderCodec, RvqCodec, VaeCodec
from motion_jax.models import cdamd, cmdm
from motion_jax.models.base import Able
from motion_jax.motion.stats import Stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.training import checkpoint
from motion_jax.utils.config_files import module_fields

STAGES = ("cmdm.tokenizer", "cmdm.denoiser", "cdamd.autoencoder", "cdamd.rvq", "cdamd.generator", "momask.rvq",
          "momask.masked", "t2m_gpt.vq", "t2m_gpt.gpt")


@dataclasses.dataclass(frozen=True, eq=False)
class Tokenizer(Able):
  """A tokenizer as an evaluation uses a model, without text. Created by `load_tokenizer`."""
  folder: pathlib.Path
  config: Any
  stats: Stats
  num_params: int
  params_file: str
  _run: Any
  abilities: ClassVar = ("round_trip",)

  def round_trip(self, x, num_frames, seeds=None):
    """Encodes and decodes normalized features x (B, T, F), padded with zeros. seeds (B,): of drawn latents; None takes
    their means.
    """
    keys = None if seeds is None else jnp.stack([jax.random.key(seed) for seed in seeds])
    return np.asarray(self._run(jnp.asarray(x), jnp.asarray(num_frames), keys))


def load_tokenizer(run, raw=False) -> Tokenizer:
  """The tokenizer of a run folder or of a shipped model. raw: the last weights, if the run is a tokenizer's own.

  Raises ValueError for a run without a tokenizer.
  """
  run = runs.load_run(run, STAGES, raw)
  config, stage = run.config, run.stage
  inside = stage in runs.TOKENIZERS
  fields = module_fields(config.tokenizer if inside else config.model)
  name = checkpoint.FROZEN if inside else run.params_file
  net = (CausalVAE if stage.startswith("cmdm") else Autoencoder)(**fields)
  if stage.startswith("cmdm"):
    codec, shapes = VaeCodec, cmdm.frozen_shapes(net)[TOKENIZER]
  elif runs.TOKENIZERS.get(stage, stage) in ("cdamd.rvq", "momask.rvq", "t2m_gpt.vq"):
    codec, shapes = RvqCodec, cdamd.autoencoder_shapes(net, config.quantizer)
  else:
    codec, shapes = AutoencoderCodec, cdamd.autoencoder_shapes(net)
  params = run.frozen({TOKENIZER: shapes})[TOKENIZER] if inside else run.params(shapes)
  params = jax.tree.map(jnp.asarray, params)
  return Tokenizer(run.folder, config, run.stats, sum(leaf.size for leaf in jax.tree.leaves(params)), name,
                   jax.jit(partial(_there_and_back, codec(net, params))))


def _there_and_back(codec, x, num_frames, keys):
  if isinstance(codec, VaeCodec):
    # Parity: the released evaluation draws latents; rows of padding are encoded and decoded like all others.
    return codec.reconstruct(x, keys)
  unit = codec.frames_per_latent
  frame_mask = padding_mask(num_frames, x.shape[1])
  if isinstance(codec, RvqCodec):
    return codec.reconstruct(x, frame_mask)
  return codec.reconstruct(x, frame_mask, padding_mask(num_frames // unit, x.shape[1] // unit))
