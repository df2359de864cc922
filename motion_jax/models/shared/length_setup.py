"""Set-up of the length estimator (`shared.length`), and its runs as frozen parts of generators."""
from typing import Any

from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import batches, sources
from motion_jax.models.shared.captioned_batches import batches_of, held_out_means
from motion_jax.models.shared.length import length_shapes, length_stage
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.text.encoder import TextEncoder, load_text_encoder
from motion_jax.training.setup import TrainingSetup, encoder_files, held_out
from motion_jax.utils.config_files import module_fields


def length_setup(config: ConfigDict) -> TrainingSetup:
  """The length estimator, on captions and the lengths that crops of their clips have in training."""
  data = sources.load_features(config.data)
  encoder = load_text_encoder(config.frozen.text, level="sentence")
  stage = length_stage(config)
  next_batch, num_items = batches_of(config, data, encoder, vectors=True)
  held, _ = batches_of(config, held_out(config, data.stats, captioned=True), encoder, vectors=True)
  without = lambda batch: {name: batch[name] for name in ("text_emb", "num_frames", "index")}

  def measure(params, frozen, batch, key):
    sums = stage.predict(params, frozen, batch, key)
    return {"loss": sums["loss"], "latents_off": sums["latents_off"], "weight": len(sums["logits"])}

  evaluate = held_out_means(lambda i: without(held(i)), measure, {},
                            ("loss", "latents_off"))
  return TrainingSetup(stage, lambda step, rows=batches.ALL: without(next_batch(step, rows)), {}, evaluate, data.stats,
                       encoder_files(encoder), num_items)


def fields_of(config: ConfigDict) -> dict[str, Any]:
  """Fields of the estimator that config.frozen.length names, for `RESOLVED` of a generator; {} where it names none."""
  return {"length": _section(_with_length(config.frozen.length)).to_dict()} if config.frozen.length else {}


def load_length(folder: str, encoder: TextEncoder) -> Any:
  """Parameters of a trained length estimator, or of a generator's, that reads the sentence vectors of this encoder."""
  run = _with_length(folder)
  run.check_encoder(encoder)
  shapes = length_shapes(LengthEstimator(**module_fields(_section(run))), encoder.dim)
  return run.params(shapes) if _is_estimator(run) else run.frozen({"length": shapes})["length"]


def _with_length(folder):
  """The run of a length estimator, or of a generator that has one. Raises ValueError for any other."""
  run = runs.load_run(folder)
  if not _is_estimator(run) and not run.config.get("length"):
    raise ValueError(f"{folder} holds a {run.stage!r} run and has no length estimator; train one with --config "
                     "cdamd_length")
  return run


def _is_estimator(run):
  return run.stage.endswith(".length")


def _section(run):
  return run.config.model if _is_estimator(run) else run.config.length
