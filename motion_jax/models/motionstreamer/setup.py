"""Training set-ups of MotionStreamer: its causal autoencoder and its generator."""

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax.data import batches, sources
from motion_jax.latents import VaeCodec
from motion_jax.models.motionstreamer.stages import END, generator_stage, tokenizer_shapes, tokenizer_stage
from motion_jax.models.shared.captioned_batches import NO_CAPTION, denoising_setup, text_encoder
from motion_jax.models.shared.frozen_parts import load_part
from motion_jax.motion.stats import Stats
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.runs import held_stats
from motion_jax.training.setup import TrainingSetup, held_out, reconstruction_error
from motion_jax.utils.errors import InputError

TOKENIZER, GENERATOR = "motionstreamer.tokenizer", "motionstreamer.generator"


def tokenizer(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
  windows = batches.Windows(data.features, config.data.window, config.data.stride, groups=data.groups,
                            balance=config.data.balance, factors=data.source_factors(config.data))
  validation, vae = held_out(config, data.stats).features, CausalVAE(**config.model)
  reconstruct = jax.jit(lambda params, x: VaeCodec(vae, params).reconstruct(x))

  def evaluate(params):
    return {"held_out_mm": round(reconstruction_error(lambda x: reconstruct(params, x), validation, data.stats), 2)}

  def next_batch(step, rows=batches.ALL):
    return windows.batch(config.data.batch_size, config.seed, step, rows)

  return TrainingSetup(tokenizer_stage(config), next_batch, {}, evaluate, data.stats, {}, len(windows))


def generator(config: ConfigDict) -> TrainingSetup:
  codec, stats = load_tokenizer(config.frozen.tokenizer, config)
  if config.model.transformer.latent_dim != codec.net.latent_dim:
    raise InputError(f"got model.transformer.latent_dim = {config.model.transformer.latent_dim}, the tokenizer's "
                     f"latents have {codec.net.latent_dim} channels; make them agree")
  data = sources.load_features(config.data, stats=stats)
  encoder = text_encoder(config, config.model.transformer.text_dim)
  if codec.mean is None:  # a bare autoencoder's latents have no scale yet
    codec = codec.fitted(data.features) if config.loss.unit_latents else codec.unscaled()
  frozen = codec.parts | {END: end_latent(codec), NO_CAPTION: encoder.no_caption()}
  return denoising_setup(config, generator_stage, data, encoder, frozen)


def end_latent(codec: VaeCodec) -> np.ndarray:
  """(C,): the latent of frames of zeros, a pose that no body takes."""
  nothing = np.zeros((1, codec.frames_per_latent, codec.net.features), np.float32)
  return np.asarray(codec.encode(nothing))[0, 0]


def load_tokenizer(folder: str, config: ConfigDict) -> tuple[VaeCodec, Stats]:
  """(codec, stats) of a trained autoencoder, without a scale of its latents (None), or of the one that a generator's
  run stands on; see `frozen_parts.load_part`."""
  part = load_part(folder, config, CausalVAE, tokenizer_shapes, (TOKENIZER, GENERATOR))
  codec = (VaeCodec.of(part.net, part.generator.frozen()) if part.generator else
           VaeCodec(part.net, part.params, None, None))
  return codec, part.stats


SETUPS = {TOKENIZER: tokenizer, GENERATOR: generator}
