"""Padded clips with the features of their captions, and the loss on held-out ones: for methods that read any words."""
import functools
from collections.abc import Callable
from typing import Any

import jax
from ml_collections import ConfigDict

from motion_jax.data import batches, sources
from motion_jax.data.batches import TextItems
from motion_jax.motion.stats import Stats
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import TextEncoder, load_text_encoder, narrowest
from motion_jax.training.setup import held_out
from motion_jax.utils.errors import InputError

NO_CAPTION = "no_text_emb"  # the name, among the frozen parts, of what an encoder makes of an empty caption (1, E)


def text_encoder(config: ConfigDict, text_dim: int) -> TextEncoder:
  """The encoder that config.frozen names. Raises InputError if it gives another width than the network takes."""
  encoder = load_text_encoder(config.frozen.text, level=config.frozen.text_level)
  if encoder.dim != text_dim:
    raise InputError(f"text encoder {config.frozen.text!r} gives {encoder.dim} numbers a "
                     f"{encoder.level.removesuffix('s')}, config.model.text_dim is {text_dim}; make them agree")
  return encoder


def text_items(config: ConfigDict, data: sources.FeatureSet) -> TextItems:
  """The clips of a data section, cut and padded as it says (`configs.common.captioned_data`)."""
  weights = batches.balance_weights(data.groups, config.data.balance) if config.data.balance else None
  rules = {name: config.data[name] for name in ("frames_per_latent", "crop_frames", "keep_long", "shorten_rate")}
  return TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                   tuple(config.data.lengths), weights=weights, **rules)


def batches_of(config: ConfigDict, data: sources.FeatureSet, encoder: TextEncoder) -> tuple[Callable[..., Any], int]:
  """(next_batch, number of clips): features (B, T, F), num_frames (B,), index (B,), text_emb (B, S, E), text_mask."""
  encoder.check(caption for captions in data.captions for caption in captions)
  items, words = text_items(config, data), narrowest(config.data.max_words)

  def next_batch(step, rows=batches.ALL):
    batch = items.batch(min(config.data.batch_size, len(items)), config.seed, step, rows)
    rng = batches.step_rng(config.seed, 2, step)
    said = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]
    batch["text_emb"], batch["text_mask"] = encoder(said, at_least=words, rows=rows)
    return batch

  return next_batch, len(items)


def held_out_loss(config: ConfigDict, stats: Stats, encoder: TextEncoder, loss: Callable[..., Any], frozen: Any,
                  num_batches: int = 4) -> Callable[[Any], dict[str, float]] | None:
  """evaluate(params): the mean of loss(params, frozen, batch, step, rng) over held-out clips, on the same batches and
  keys every time; None where no held-out clip is long enough."""
  try:
    next_batch, _ = batches_of(config, held_out(config, stats, captioned=True), encoder)
  except ValueError as error:
    print(f"note: no loss on held-out clips: {error}")
    return None
  compiled, batch = jax.jit(loss), functools.cache(next_batch)

  def evaluate(params):
    parts = [compiled(params, frozen, batch(i), 0, jax.random.key(i)) for i in range(num_batches)]
    return {"held_out_loss": round(sum(float(sums["loss"]) for sums, _ in parts) / sum(
        float(weight) for _, weight in parts), 5)}

  return evaluate
