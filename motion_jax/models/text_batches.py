"""Batches of captioned clips for methods whose generators read padded clips and a sentence vector."""
import functools
from collections.abc import Callable
from typing import Any

from ml_collections import ConfigDict

from motion_jax.data import batches, store
from motion_jax.data.sources import FeatureSet
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import TextEncoder

_RULES = ("frames_per_latent", "crop_frames", "keep_long", "shorten_rate")  # of `batches.TextItems`


def items_of(config: ConfigDict, data: FeatureSet) -> batches.TextItems:
  """The captioned clips of a config's data, as they are cut and padded."""
  weights = batches.balance_weights(data.groups, config.data.balance) if config.data.balance else None
  rules = {name: config.data[name] for name in _RULES if name in config.data}  # the length estimator's has them not
  return batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                           tuple(config.data.lengths), weights=weights, **rules)


def captioned(config: ConfigDict, data: FeatureSet, encoder: TextEncoder, encoders: Any = None
              ) -> tuple[Callable[..., dict[str, Any]], int]:
  """(next_batch, how many clips there are): padded clips with the sentence vectors of their captions, or these and
  their words.

  encoders: the parameters by which the store config.data.store was made, whose latents then take the features' place.
  """
  encoder.check(caption for captions in data.captions for caption in captions)
  items = items_of(config, data)
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
