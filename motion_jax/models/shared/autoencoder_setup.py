"""Set-ups of the autoencoders that several methods share: their data, and their runs as frozen parts of others."""
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import batches, sources
from motion_jax.latents import RvqCodec
from motion_jax.models.shared import motion_errors
from motion_jax.models.shared.autoencoders import autoencoder_shapes, autoencoder_stage, rvq_stage
from motion_jax.models.shared.captioned_batches import clips_of
from motion_jax.models.shared.critic import with_critic
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.stats import Stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.quant import vq
from motion_jax.runs import held_stats
from motion_jax.training.setup import (
  TrainingSetup,
  demand_same_network,
  held_out,
  reconstruction_error,
  untrained,
)
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError


def autoencoder(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
  net = Autoencoder(**config.model)
  evaluate = _reconstruction(config, data.stats, net.apply)
  frozen = motion_errors.frozen_stats(config, data.stats)
  next_batch, num_items = _windows(config, data)
  stage = with_critic(autoencoder_stage(config), config)
  return TrainingSetup(stage, next_batch, frozen, evaluate, data.stats, {}, num_items)


def rvq(config: ConfigDict) -> TrainingSetup:
  """On windows or, where config.data.window is 0, on the whole padded clips of the text loader."""
  net = Autoencoder(**config.model)
  if config.data.window:
    data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
    next_batch, num_items = _windows(config, data)
  else:
    data = sources.load_features(config.data, stats=held_stats(config))
    next_batch, num_items = clips_of(config, data)

  def reconstruct(variables, x):
    return RvqCodec(net, variables).reconstruct(x)

  evaluate = _reconstruction(config, data.stats, reconstruct)
  frozen = motion_errors.frozen_stats(config, data.stats)
  return TrainingSetup(rvq_stage(config), next_batch, frozen, evaluate, data.stats, {}, num_items)


def _windows(config, data):
  """(next_batch, how many windows there are)."""
  frames_per_latent = 2 ** config.model.num_halvings
  for name in ("window", "short_window"):
    if config.data[name] % frames_per_latent:
      raise ValueError(f"got data.{name} = {config.data[name]}, expected a multiple of the {frames_per_latent} "
                       "frames of a latent")
  windows = batches.Windows(data.features, config.data.window, config.data.stride,
                            config.data.released_windows, data.groups, config.data.balance,
                            config.data.short_window, config.data.get("one_per_clip", False),
                            data.source_factors(config.data))
  return lambda step, rows=batches.ALL: windows.batch(config.data.batch_size, config.seed, step, rows), len(windows)


def _reconstruction(config, stats, reconstruct):
  """evaluate(variables): mean joint error of held-out clips in millimetres, each frame's root at the same place."""
  validation = held_out(config, stats).features
  compiled = jax.jit(reconstruct)

  def evaluate(variables):
    error = reconstruction_error(lambda x: compiled(variables, x), validation, stats)
    return {"held_out_mm": round(error, 2)}

  return evaluate


def load_frozen(folder: str, fields: ConfigDict, stage: str, config: ConfigDict,
                quantizer: ConfigDict | None = None) -> tuple[Autoencoder, Any, Stats]:
  """(module, variables, stats) of a trained autoencoder or, with a quantizer section, RVQ-VAE; "random-init" makes an
  untrained one for trying things out."""
  net = Autoencoder(**module_fields(fields))
  if folder == "random-init":
    variables = untrained(autoencoder_shapes(net))
    if quantizer:
      codes = np.random.default_rng(1).standard_normal(
          (quantizer.num_levels, quantizer.num_codes, net.latent_dim), np.float32)
      variables = {**variables, "codebooks": vq.codebook_of(codes)._asdict()}
    return net, variables, sources.load_features(config.data).stats
  run = runs.load_run(folder, stage)
  demand_alike(folder, run.config.model, fields)
  trained = run.config.get("quantizer")
  if quantizer and (trained.num_levels, trained.num_codes) != (quantizer.num_levels, quantizer.num_codes):
    raise ValueError(f"{folder} has {trained.num_levels} levels of {trained.num_codes} codes, config.quantizer says "
                     f"{quantizer.num_levels} of {quantizer.num_codes}; make them agree")
  variables = run.params(autoencoder_shapes(net, quantizer))
  return net, variables, stats_lib.load_stats(folder, config.data.layout)


def load_codes(config: ConfigDict, stage: str) -> tuple[Autoencoder, Any, Stats]:
  """`load_frozen` of the RVQ-VAE whose codes a transformer is trained on: config.frozen.tokenizer."""
  if config.model.num_codes != config.quantizer.num_codes:
    raise InputError(f"got model.num_codes = {config.model.num_codes}, the quantizer has {config.quantizer.num_codes} "
                     "codes; make them agree")
  return load_frozen(config.frozen.tokenizer, config.tokenizer, stage, config, config.quantizer)


def demand_alike(folder: str, theirs: ConfigDict, fields: ConfigDict) -> None:
  """Raises ValueError where the autoencoder in a folder is not that of a config's section."""
  theirs, ours = (Autoencoder(**module_fields(section)) for section in (theirs, fields))
  # Frozen, it has no dropout; windows have no padding.
  demand_same_network(f"the autoencoder in {folder}", theirs, ours, "this config", dropout=0.0, hide_padding=False)
