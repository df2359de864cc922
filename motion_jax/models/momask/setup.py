"""Training set-ups of MoMask: its RVQ-VAE, its two transformers, its length estimator."""
from typing import Any

from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import sources
from motion_jax.latents import TOKENIZER
from motion_jax.models.momask.stages import masked_stage, residual_shapes, residual_stage
from motion_jax.models.shared import length_setup
from motion_jax.models.shared.autoencoder_setup import load_codes, rvq
from motion_jax.models.shared.captioned_batches import batches_of, held_out_means, text_encoder, text_files
from motion_jax.nets.token_transformers import ResidualCodeTransformer
from motion_jax.text.encoder import TextEncoder
from motion_jax.training.setup import TrainingSetup, held_out
from motion_jax.utils.config_files import module_fields

MASKED, RESIDUAL = "momask.masked", "momask.residual"


def masked(config: ConfigDict) -> TrainingSetup:
  """The masked transformer; with it lie a residual transformer and a length estimator, where the config names them."""
  def more(encoder):
    parts = {"residual": load_residual(config, encoder)} if config.frozen.residual else {}
    return parts | ({"length": length_setup.load_length(config.frozen.length, encoder)} if config.frozen.length else {})

  return _transformer(config, masked_stage(config), more)


def residual(config: ConfigDict) -> TrainingSetup:
  """The residual transformer."""
  if config.model.num_levels != config.quantizer.num_levels:
    raise ValueError(f"got model.num_levels = {config.model.num_levels}, the quantizer has "
                     f"{config.quantizer.num_levels} levels; make them agree")
  return _transformer(config, residual_stage(config), lambda encoder: {})


def _transformer(config, stage, more):
  _, variables, stats = load_codes(config, "momask.rvq")
  data = sources.load_features(config.data, stats=stats)
  encoder = text_encoder(config, config.model.text_dim, "sentence")
  frozen = {TOKENIZER: variables} | more(encoder)
  next_batch, num_items = batches_of(config, data, encoder, vectors=True)
  held, _ = batches_of(config, held_out(config, stats, captioned=True), encoder, vectors=True)
  evaluate = held_out_means(held, stage.predict, frozen, ("loss", "accuracy"))
  return TrainingSetup(stage, next_batch, frozen, evaluate, data.stats, text_files(data, encoder), num_items)


def load_residual(config: ConfigDict, encoder: TextEncoder) -> Any:
  """Parameters of the residual transformer that config.frozen.residual names, of the same codes and text."""
  folder = config.frozen.residual
  run = runs.load_run(folder, RESIDUAL)
  run.check_encoder(encoder)
  trained, wanted = run.config.quantizer.to_dict(), config.quantizer.to_dict()
  if trained != wanted:
    raise ValueError(f"{folder} was trained on codes of {trained}, this config says {wanted}; train both transformers "
                     "on one RVQ-VAE")
  return run.params(residual_shapes(ResidualCodeTransformer(**module_fields(run.config.model))))


def resolved(config: ConfigDict) -> dict[str, Any]:
  """Config fields of the masked transformer from other runs: sizes of residual transformer and length estimator."""
  fields = length_setup.fields_of(config)
  if config.frozen.residual:
    fields["residual"] = runs.load_run(config.frozen.residual, RESIDUAL).config.model.to_dict()
  return fields


RESOLVED = {MASKED: resolved}
SETUPS = {"momask.rvq": rvq, MASKED: masked, RESIDUAL: residual, "momask.length": length_setup.length_setup}
