"""Training set-ups of CDAMD: how its two autoencoders and its generator are trained."""
import os

import numpy as np
from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import sources, store
from motion_jax.latents import AutoencoderCodec, RvqCodec
from motion_jax.models import cdamd
from motion_jax.models.shared import length_setup as lengths
from motion_jax.models.shared.autoencoder_setup import autoencoder, demand_alike, load_frozen, rvq
from motion_jax.models.shared.captioned_batches import batches_of, held_out_means, items_of, text_encoder, text_files
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.stats import Stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from motion_jax.training.setup import TrainingSetup, held_out
from motion_jax.utils.config_files import module_fields

GENERATOR = "cdamd.generator"


def _generator_parts(config):
  """(data, text encoder, codec, frozen parts) of a generator's config."""
  _check_fields(config)
  codec, stats = load_tokenizer(config.frozen.tokenizer, config)
  frozen = {}
  if config.loss.prior_levels:
    _, frozen["prior"], others = load_frozen(config.frozen.prior, config.prior, "cdamd.rvq", config, config.quantizer)
    if not np.allclose(stats.mean, others.mean, rtol=1e-3, atol=1e-3 * stats.std.max()) or not np.allclose(
        stats.std, others.std, rtol=1e-2):
      raise ValueError(f"{config.frozen.tokenizer} and {config.frozen.prior} were trained on other data: their "
                       "statistics differ; train both on the same")
  data = sources.load_features(config.data, stats=stats)
  if codec.mean is None:  # a bare autoencoder's latents have no scale yet
    codec = codec.fitted(data.features) if config.loss.unit_latents else codec.unscaled()
  frozen |= codec.parts
  encoder = text_encoder(config, config.model.transformer.text_dim)
  if config.frozen.length and config.frozen.text_level != "sentence":
    raise ValueError("the length estimator reads sentence vectors; leave frozen.length empty or set "
                     "frozen.text_level = 'sentence'")
  return data, encoder, codec, frozen


def generator(config: ConfigDict) -> TrainingSetup:
  """The masked transformer and its diffusion head, on latents of a trained autoencoder, with codes of a trained RVQ."""
  data, encoder, codec, frozen = _generator_parts(config)
  encoders = dict(frozen)
  if config.frozen.length:
    frozen["length"] = lengths.load_length(config.frozen.length, encoder)
  batch_of, num_items = batches_of(config, data, encoder, True, encoders if config.data.store else None)
  stage = cdamd.generator_stage(config)
  evaluate = _held_out_loss(config, stage, frozen, data.stats, encoder)
  return TrainingSetup(stage, batch_of, frozen, evaluate, data.stats, text_files(data, encoder), num_items)


def _check_fields(config):
  """Raises ValueError for sections that do not fit each other: jax would clamp a code that its table lacks."""
  transformer, levels = config.model.transformer, config.loss.prior_levels
  if transformer.latent_dim != config.tokenizer.latent_dim:
    raise ValueError(f"got model.transformer.latent_dim = {transformer.latent_dim}, the tokenizer's latents have "
                     f"{config.tokenizer.latent_dim} channels; make them agree")
  if not levels:
    return
  if transformer.kind == "mardm":
    raise ValueError(f"got loss.prior_levels = {levels}, MARDM's transformer has no prior; set it to 0")
  if config.quantizer.num_codes > transformer.num_codes:
    raise ValueError(f"got quantizer.num_codes = {config.quantizer.num_codes}, the transformer has a table of "
                     f"model.transformer.num_codes = {transformer.num_codes}; make them agree")
  if levels > min(config.quantizer.num_levels, transformer.num_levels):
    raise ValueError(f"got loss.prior_levels = {levels}, the quantizer has {config.quantizer.num_levels} levels, the "
                     f"transformer knows {transformer.num_levels}; take fewer")


def encode_generator(config: ConfigDict, folder: str | os.PathLike) -> str:
  """Writes the store of a generator's data: latents, and codes where its loss has a prior; returns a line of summary.
  """
  data, encoder, codec, frozen = _generator_parts(config)
  net, prior = codec.net, Autoencoder(**module_fields(config.prior))
  levels = config.quantizer.num_levels

  def encode(frozen, x, num_frames):
    real_mask = padding_mask(num_frames // net.frames_per_latent, x.shape[1] // net.frames_per_latent)
    encoded = {"latents": AutoencoderCodec.of(net, frozen).encode(x, real_mask)}
    if "prior" in frozen:
      encoded["codes"] = RvqCodec(prior, frozen["prior"]).encode(x, codec.real_frames(real_mask))[0][..., :levels]
    return encoded

  return store.encode(folder, frozen, items_of(config, data), encoder, encode, config.data.vary_subject > 0,
                      latents_look_back=False)


def _held_out_loss(config, stage, frozen, stats, encoder):
  """evaluate(params): the loss as the sampler sees the network (its mask, captions, no prior, no dropout) and with the
  prior given, as the reference validates; on the same few batches of held-out clips and the same noise every time."""
  next_batch, _ = batches_of(config, held_out(config, stats, captioned=True), encoder, vectors=True)
  return held_out_means(next_batch, stage.predict, frozen, ("loss", "with_prior"))


def load_tokenizer(folder: str, config: ConfigDict) -> tuple[AutoencoderCodec, Stats]:
  """(codec, stats) of a trained autoencoder, without a scale of its latents (None), or of the one that a generator's
  run or a model that ships stands on, with the scale that the generator knows; "random-init" as in `load_frozen`."""
  if folder != "random-init":
    run = runs.load_run(folder, ("cdamd.autoencoder", GENERATOR))
    if run.stage == GENERATOR:
      demand_alike(folder, run.config.tokenizer, config.tokenizer)
      if run.config.loss.unit_latents != config.loss.unit_latents:
        raise ValueError(f"the latents of {folder} are known by their own scale (loss.unit_latents = "
                         f"{run.config.loss.unit_latents}), config.loss.unit_latents is {config.loss.unit_latents}; "
                         "make them agree")
      net = Autoencoder(**module_fields(config.tokenizer))
      return AutoencoderCodec.of(net, run.frozen(cdamd.frozen_shapes(net))), stats_lib.load_stats(
          run.folder, config.data.layout)
  net, params, stats = load_frozen(folder, config.tokenizer, "cdamd.autoencoder", config)
  return AutoencoderCodec(net, params, None, None), stats


RESOLVED = {GENERATOR: lengths.fields_of}
STORES = {"cdamd.generator": encode_generator}
SETUPS = {"cdamd.autoencoder": autoencoder, "cdamd.rvq": rvq, "cdamd.generator": generator,
          "cdamd.length": lengths.length_setup}
