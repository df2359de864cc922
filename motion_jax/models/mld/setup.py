"""Training set-ups of MLD: its VAE and its denoiser."""
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax.data import sources
from motion_jax.models.mld.stages import VAE, denoiser_stage, frames_stage, reconstruct, vae_shapes, vae_stage
from motion_jax.models.shared.captioned_batches import NO_CAPTION, clips_of, denoising_setup, text_encoder
from motion_jax.models.shared.frozen_parts import load_part
from motion_jax.models.shared.motion_errors import STATS
from motion_jax.motion.stats import Stats
from motion_jax.nets.latent_diffusion import TokenVAE
from motion_jax.training.setup import TrainingSetup, held_out, reconstruction_error
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError


def vae(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data)
  next_batch, num_items = clips_of(config, data)
  net = TokenVAE(**config.model)
  validation, length = held_out(config, data.stats).features, config.data.max_frames
  compiled = jax.jit(lambda params, x, real: reconstruct(net, params, x, real))

  def evaluate(params):
    real = np.ones((1, length), bool)
    error = reconstruction_error(lambda x: compiled(params, x, real), validation, data.stats, length)
    return {"held_out_mm": round(error, 2)}

  frozen = {STATS: {"mean": data.stats.mean, "std": data.stats.std}}
  return TrainingSetup(vae_stage(config), next_batch, frozen, evaluate, data.stats, {}, num_items)


def denoiser(config: ConfigDict) -> TrainingSetup:
  latent_dim = TokenVAE(**module_fields(config.tokenizer)).latent_dim
  if (config.model.get("latent_width") or config.model.width) != latent_dim:
    raise InputError(f"got model.width = {config.model.width}, the latents of config.tokenizer have {latent_dim} "
                     "numbers; make them agree, or say so by model.latent_width")
  params, stats = load_vae(config.frozen.tokenizer, config)
  return _denoising(config, denoiser_stage, sources.load_features(config.data, stats=stats), {VAE: params})


def frames(config: ConfigDict) -> TrainingSetup:
  """The denoiser without a VAE."""
  return _denoising(config, frames_stage, sources.load_features(config.data), {})


def _denoising(config, stage_of, data, frozen):
  encoder = text_encoder(config, config.model.text_dim)
  return denoising_setup(config, stage_of, data, encoder, frozen | {NO_CAPTION: encoder.no_caption()})


def load_vae(folder: str, config: ConfigDict) -> tuple[Any, Stats]:
  """(parameters, stats) of a trained VAE; see `frozen_parts.load_part`."""
  part = load_part(folder, config, TokenVAE, vae_shapes, ("mld.vae",), "the VAE", dropout=0.0)
  return part.params, part.stats


SETUPS = {"mld.vae": vae, "mld.denoiser": denoiser, "mld.frames": frames}
