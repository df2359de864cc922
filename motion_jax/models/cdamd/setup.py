"""Training set-ups of CDAMD: how its two autoencoders and its generator are trained."""
import functools
import os
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import batches, sources, store
from motion_jax.latents import AutoencoderCodec, RvqCodec
from motion_jax.models import cdamd, motion_errors
from motion_jax.models.cdamd import length as lengths
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.stats import Stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.nets.masks import padding_mask
from motion_jax.quant import vq
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import TextEncoder, load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import (
  TrainingSetup,
  caption_lengths,
  encoder_files,
  held_out,
  held_stats,
  reconstruction_error,
  untrained,
)
from motion_jax.utils.config_files import module_fields

GENERATOR = "cdamd.generator"
_RULES = ("frames_per_latent", "crop_frames", "keep_long", "shorten_rate")  # of `batches.TextItems`


def autoencoder(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
  net = Autoencoder(**config.model)
  evaluate = _reconstruction(config, data.stats, net.apply)
  frozen = motion_errors.frozen_stats(config, data.stats)
  next_batch, num_items = _windows(config, data)
  return TrainingSetup(cdamd.autoencoder_stage(config), next_batch, frozen, evaluate, data.stats, {}, num_items)


def rvq(config: ConfigDict) -> TrainingSetup:
  """On windows or, where config.data.window is 0, on the whole padded clips of the text loader."""
  net = Autoencoder(**config.model)
  if config.data.window:
    data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
    next_batch, num_items = _windows(config, data)
  else:
    data = sources.load_features(config.data, stats=held_stats(config))
    weights = batches.balance_weights(data.groups, config.data.balance) if config.data.balance else None
    items = batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                              (config.data.max_frames,), weights=weights)
    num_items = len(items)

    def next_batch(step, rows=batches.ALL):
      batch = items.batch(config.data.batch_size, config.seed, step, rows)
      return {name: batch[name] for name in ("features", "index", "num_frames")}

  def reconstruct(variables, x):
    return RvqCodec(net, variables).reconstruct(x)

  evaluate = _reconstruction(config, data.stats, reconstruct)
  frozen = motion_errors.frozen_stats(config, data.stats)
  return TrainingSetup(cdamd.rvq_stage(config), next_batch, frozen, evaluate, data.stats, {}, num_items)


def _windows(config, data):
  """(next_batch, how many windows there are)."""
  frames_per_latent = 2 ** config.model.num_halvings
  for name in ("window", "short_window"):
    if config.data[name] % frames_per_latent:
      raise ValueError(f"got data.{name} = {config.data[name]}, expected a multiple of the {frames_per_latent} "
                       "frames of a latent")
  windows = batches.Windows(data.features, config.data.window, config.data.stride,
                            config.data.released_windows, data.groups, config.data.balance,
                            config.data.short_window)
  return lambda step, rows=batches.ALL: windows.batch(config.data.batch_size, config.seed, step, rows), len(windows)


def _reconstruction(config, stats, reconstruct):
  """evaluate(variables): mean joint error of held-out clips in millimetres, each frame's root at the same place."""
  validation = held_out(config, stats).features
  compiled = jax.jit(reconstruct)

  def evaluate(variables):
    error = reconstruction_error(lambda x: compiled(variables, x), validation, stats)
    return {"held_out_mm": round(error, 2)}

  return evaluate


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
  level = config.frozen.text_level
  encoder = load_text_encoder(config.frozen.text, level=level)
  if config.frozen.length and level != "sentence":
    raise ValueError("the length estimator reads sentence vectors; leave frozen.length empty or set "
                     "frozen.text_level = 'sentence'")
  if encoder.dim != config.model.transformer.text_dim:
    raise ValueError(f"text encoder {config.frozen.text!r} gives {encoder.dim} numbers a sentence, the model takes "
                     f"model.transformer.text_dim = {config.model.transformer.text_dim}; make them agree")
  return data, encoder, codec, frozen


def generator(config: ConfigDict) -> TrainingSetup:
  """The masked transformer and its diffusion head, on latents of a trained autoencoder, with codes of a trained RVQ."""
  data, encoder, codec, frozen = _generator_parts(config)
  encoders = dict(frozen)
  if config.frozen.length:
    frozen["length"] = load_length(config.frozen.length, encoder)
  batch_of, num_items = _captioned(config, data, encoder, encoders if config.data.store else None)
  stage = cdamd.generator_stage(config)
  files = {checkpoint.LENGTHS: caption_lengths(data), **encoder_files(encoder)}
  evaluate = _held_out_loss(config, stage, frozen, data.stats, encoder)
  return TrainingSetup(stage, batch_of, frozen, evaluate, data.stats, files, num_items)


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


def _items(config, data):
  weights = batches.balance_weights(data.groups, config.data.balance) if config.data.balance else None
  rules = {name: config.data[name] for name in _RULES if name in config.data}  # the length estimator's has them not
  return batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                           tuple(config.data.lengths), weights=weights, **rules)


def _captioned(config, data, encoder, encoders=None):
  """(next_batch, how many clips there are): padded clips with the sentence vectors of their captions, or these and
  their words.

  encoders: the parameters by which the store config.data.store was made, whose latents then take the features' place.
  """
  encoder.check(caption for captions in data.captions for caption in captions)
  items = _items(config, data)
  draw = items.batch
  if encoders is not None:
    kept = store.Store(config.data.store)
    kept.require(store.identity_of(encoders, items, encoder))
    encoder.recall(kept.words)
    tables = ("latents", "codes") if config.loss.prior_levels else ("latents",)
    draw = functools.partial(store.stored_batch, kept, items, tables, latents_look_back=False)

  def next_batch(step, rows=batches.ALL):
    batch = draw(min(config.data.batch_size, len(items)), config.seed, step, rows)
    rng = batches.step_rng(config.seed, 2, step)
    said = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]
    if encoder.level == "sentence":
      return batch | {"text_emb": encoder(said, rows=rows)[0]}
    at_least = min(config.data.max_words, encoder.max_words)
    text_emb, text_mask = encoder.sentence_and_words(said, at_least, rows)
    return batch | {"text_emb": text_emb, "text_mask": text_mask}

  return next_batch, len(items)


def encode_generator(config: ConfigDict, folder: str | os.PathLike) -> str:
  """Writes the store of a generator's data: latents, and codes where its loss has a prior; returns what to tell."""
  data, encoder, codec, frozen = _generator_parts(config)
  net, prior = codec.net, Autoencoder(**module_fields(config.prior))
  levels = config.quantizer.num_levels

  def encode(frozen, x, num_frames):
    real_mask = padding_mask(num_frames // net.frames_per_latent, x.shape[1] // net.frames_per_latent)
    made = {"latents": AutoencoderCodec.of(net, frozen).encode(x, real_mask)}
    if "prior" in frozen:
      made["codes"] = RvqCodec(prior, frozen["prior"]).encode(x, codec.real_frames(real_mask))[0][..., :levels]
    return made

  return store.encode(folder, frozen, _items(config, data), encoder, encode, config.data.vary_subject > 0,
                      latents_look_back=False)


def _held_out_loss(config, stage, frozen, stats, encoder, num_batches=4):
  """evaluate(params): the loss as the sampler sees the network (its mask, captions, no prior, no dropout) and with the
  prior given, as the reference validates; on the same few batches of held-out clips and the same noise every time."""
  next_batch, _ = _captioned(config, held_out(config, stats, captioned=True), encoder)
  predict = jax.jit(stage.predict)

  def evaluate(params):
    parts = [predict(params, frozen, next_batch(i), jax.random.key(i)) for i in range(num_batches)]
    total = {name: sum(float(part[name]) for part in parts) for name in parts[0]}
    names = {"loss": "held_out_loss", "with_prior": "held_out_with_prior"}
    return {names[name]: round(value / total["weight"], 5) for name, value in total.items() if name in names}

  return evaluate


def load_frozen(folder: str, fields: ConfigDict, stage: str, config: ConfigDict,
                quantizer: ConfigDict | None = None) -> tuple[Autoencoder, Any, Stats]:
  """(module, variables, stats) of a trained autoencoder or, with a quantizer section, RVQ-VAE; "random-init" makes an
  untrained one for trying things out."""
  net = Autoencoder(**module_fields(fields))
  if folder == "random-init":
    variables = untrained(cdamd.autoencoder_shapes(net))
    if quantizer:
      codes = np.random.default_rng(1).standard_normal(
          (quantizer.num_levels, quantizer.num_codes, net.latent_dim), np.float32)
      variables = {**variables, "codebooks": vq.codebook_of(codes)._asdict()}
    return net, variables, sources.load_features(config.data).stats
  run = runs.load_run(folder, stage)
  _demand_alike(folder, run.config.model, fields)
  own = run.config.get("quantizer")
  if quantizer and (own.num_levels, own.num_codes) != (quantizer.num_levels, quantizer.num_codes):
    raise ValueError(f"{folder} has {own.num_levels} levels of {own.num_codes} codes, config.quantizer says "
                     f"{quantizer.num_levels} of {quantizer.num_codes}; make them agree")
  variables = run.params(cdamd.autoencoder_shapes(net, quantizer))
  return net, variables, stats_lib.load_stats(folder, config.data.layout)


def load_tokenizer(folder: str, config: ConfigDict) -> tuple[AutoencoderCodec, Stats]:
  """(codec, stats) of a trained autoencoder, without a scale of its latents (None), or of the one that a generator's
  run or a model that ships stands on, with the scale that the generator knows; "random-init" as in `load_frozen`."""
  if folder != "random-init":
    run = runs.load_run(folder, ("cdamd.autoencoder", GENERATOR))
    if run.stage == GENERATOR:
      _demand_alike(folder, run.config.tokenizer, config.tokenizer)
      if run.config.loss.unit_latents != config.loss.unit_latents:
        raise ValueError(f"the latents of {folder} are known by their own scale (loss.unit_latents = "
                         f"{run.config.loss.unit_latents}), config.loss.unit_latents is {config.loss.unit_latents}; "
                         "make them agree")
      net = Autoencoder(**module_fields(config.tokenizer))
      return AutoencoderCodec.of(net, run.frozen(cdamd.frozen_shapes(net))), stats_lib.load_stats(
          run.folder, config.data.layout)
  net, params, stats = load_frozen(folder, config.tokenizer, "cdamd.autoencoder", config)
  return AutoencoderCodec(net, params, None, None), stats


def _demand_alike(folder, theirs, fields):
  """Raises ValueError where the autoencoder in a folder is not that of a config's section."""
  alike: dict[str, Any] = dict(dropout=0.0, hide_padding=False)  # frozen, it has no dropout; windows have no padding
  theirs, fields = module_fields(theirs), module_fields(fields)
  if Autoencoder(**theirs).clone(**alike) != Autoencoder(**fields).clone(**alike):
    raise ValueError(f"{folder} holds {theirs}, this config says {fields}; make them agree")


def length(config: ConfigDict) -> TrainingSetup:
  """The length estimator, on captions and the lengths that crops of their clips have in training."""
  data = sources.load_features(config.data)
  encoder = load_text_encoder(config.frozen.text, level="sentence")
  stage = lengths.length_stage(config)
  next_batch, num_items = _captioned(config, data, encoder)
  held, _ = _captioned(config, held_out(config, data.stats, captioned=True), encoder)
  without = lambda batch: {name: batch[name] for name in ("text_emb", "num_frames", "index")}
  predict = jax.jit(stage.predict)

  def evaluate(params):
    parts = [predict(params, {}, without(held(i)), None) for i in range(4)]
    count = sum(len(part["logits"]) for part in parts)
    return {f"held_out_{name}": round(float(sum(part[name] for part in parts)) / count, 4)
            for name in ("loss", "latents_off")}

  return TrainingSetup(stage, lambda step, rows=batches.ALL: without(next_batch(step, rows)), {}, evaluate, data.stats,
                       encoder_files(encoder), num_items)


def generator_fields(config: ConfigDict) -> dict[str, Any]:
  """What loading the generator's run needs: the sizes of its length estimator, where it has one."""
  if not config.frozen.length:
    return {}
  run = _with_length(config.frozen.length)
  return {"length": (run.config.length if run.stage == GENERATOR else run.config.model).to_dict()}


def _with_length(folder):
  """The run of a length estimator, or of a generator that has one. Raises ValueError for a generator without."""
  run = runs.load_run(folder, ("cdamd.length", GENERATOR))
  if run.stage == GENERATOR and not run.config.length:
    raise ValueError(f"{folder} has no length estimator; train one with --config cdamd_length")
  return run


def load_length(folder: str, encoder: TextEncoder) -> Any:
  """Parameters of a trained length estimator, or of a generator's, that reads the sentence vectors of this encoder."""
  run = _with_length(folder)
  run.check_encoder(encoder)
  inside = run.stage == GENERATOR
  net = LengthEstimator(**module_fields(run.config.length if inside else run.config.model))
  shapes = lengths.length_shapes(net, encoder.dim)
  return run.frozen({"length": shapes})["length"] if inside else run.params(shapes)


RESOLVED = {GENERATOR: generator_fields}
STORES = {"cdamd.generator": encode_generator}
SETUPS = {"cdamd.autoencoder": autoencoder, "cdamd.rvq": rvq, "cdamd.generator": generator, "cdamd.length": length}
