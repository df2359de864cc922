"""Batches of padded clips with encoded captions, and losses on held-out clips: for every generator."""
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax.data import batches, sources, store
from motion_jax.data.contradictions import contradict
from motion_jax.motion.stats import Stats
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import TextEncoder, load_text_encoder
from motion_jax.text.padding import narrowest
from motion_jax.training import checkpoint
from motion_jax.training.setup import TrainingSetup, caption_lengths, encoder_files, held_out, resolve_epochs
from motion_jax.training.stage import Stage
from motion_jax.utils.errors import InputError

NO_CAPTION = "no_text_emb"  # the name, among the frozen parts, of the embedding (1, E) of an empty caption
_RULES = ("frames_per_latent", "crop_frames", "keep_long", "shorten_rate")  # of `batches.TextItems`
# Fields for random dropping and for the contrast term, which `undisturbed` turns off.
_DISTURBED = (("loss", "drop_rate"), ("loss", "crop_rate"), ("loss", "contrast"), ("model", "dropout"))


def text_encoder(config: ConfigDict, text_dim: int, level: str | None = None) -> TextEncoder:
  """The encoder that config.frozen names. Raises InputError if it gives another width than the network takes.

  level: "sentence" or "words"; without it that of config.frozen.text_level.
  """
  encoder = load_text_encoder(config.frozen.text, config.frozen.get("text_pieces") or None,
                              level or config.frozen.text_level)
  if encoder.dim != text_dim:
    raise InputError(f"text encoder {config.frozen.text!r} gives {encoder.dim} numbers a "
                     f"{encoder.level.removesuffix('s')}, the model takes text_dim = {text_dim}; make them agree")
  return encoder


def text_files(data: sources.FeatureSet, encoder: TextEncoder) -> dict[str, str | bytes]:
  """Caption files of a generator's run folder: the usual length of each caption's motions, and the encoder's identity.

  Captions that the encoder cannot take are left out: the application compares prompts with all that are kept.
  """
  long = encoder.too_long([caption for captions in data.own_captions for caption in captions])
  return {checkpoint.LENGTHS: caption_lengths(data, long), **encoder_files(encoder)}


def items_of(config: ConfigDict, data: sources.FeatureSet) -> batches.TextItems:
  """The clips of a data section, cut and padded as it says (`configs.common.captioned_data`)."""
  rules = {name: config.data[name] for name in _RULES if name in config.data}
  return batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                           tuple(config.data.get("lengths", (config.data.max_frames,))),
                           weights=data.draw_weights(config.data), **rules)


def clips_of(config: ConfigDict, data: sources.FeatureSet) -> tuple[Callable[..., Any], int]:
  """(next_batch, number of clips) without the captions: features (B, T, F), num_frames (B,), index (B,)."""
  items = items_of(config, data)

  def next_batch(step, rows=batches.ALL):
    batch = items.batch(min(config.data.batch_size, len(items)), config.seed, step, rows)
    return {name: batch[name] for name in ("features", "num_frames", "index")}

  return next_batch, len(items)


def batches_of(config: ConfigDict, data: sources.FeatureSet, encoder: TextEncoder, vectors: bool = False,
               encoders: Any = None) -> tuple[Callable[..., Any], int]:
  """(next_batch, number of clips): features (B, T, F), num_frames (B,), index (B,), and `with_text`.

  encoders: the parameters that encoded the store config.data.store; its latents then replace the features.
  """
  check_captions(data, encoder)
  items = items_of(config, data)
  draw = items.batch
  if encoders is not None:
    kept = store.Store(config.data.store)
    kept.require(store.identity_of(encoders, items, encoder))
    encoder.recall(kept.words)
    tables = ("latents", "codes") if config.loss.prior_levels else ("latents",)
    draw = functools.partial(store.stored_batch, kept, items, tables, latents_look_back=False)
  reader = encoder.for_training()

  def next_batch(step, rows=batches.ALL):
    batch = draw(min(config.data.batch_size, len(items)), config.seed, step, rows)
    return with_text(batch, config, reader, step, rows, vectors)

  return next_batch, len(items)


def check_captions(data: sources.FeatureSet, encoder: TextEncoder) -> None:
  """Takes captions that are too long for the encoder out of the data, with a note. Raises ValueError for a clip that
  has no other."""
  every = [caption for captions in data.captions for caption in captions]
  long = encoder.too_long(every)
  if any(captions and long.keys() >= set(captions) for captions in data.captions):
    encoder.check(every)
  for captions in data.captions if long else ():
    captions[:] = [caption for caption in captions if caption not in long]
  if long:
    print(f"note: captions left out, as they are longer than the {encoder.max_words} word pieces that the text encoder "
          f"takes: {len(long)}; their clips have others")


def contradicted(captions: Sequence[str], seed: int, step: int) -> dict[str, str]:
  """{caption: one of its contradictions} (`data.contradictions`), drawn in each step; itself where it has none."""
  captions = list(dict.fromkeys(captions))
  return dict(zip(captions, map(contradict, captions, batches.step_rng(seed, 7, step).random(len(captions)))))


def contradictions_of(own: dict[str, Any], false: dict[str, Any], differ: Sequence[bool]) -> dict[str, Any]:
  """Entries of a batch for contrast with contradicting captions: text_emb, text_mask, false_emb, false_mask, has_false
  (B,).

  own, false: {"text_emb", "text_mask"} of the captions and of their contradictions, which are padded to the wider of
  the two. differ: for each row, whether its caption has a contradiction.
  """
  width = max(own["text_mask"].shape[-1], false["text_mask"].shape[-1])
  widened: dict[str, Any] = {}
  for prefix, sides in (("text", own), ("false", false)):
    emb, mask = sides["text_emb"], sides["text_mask"]
    more = (0, width - mask.shape[-1])
    widened |= {f"{prefix}_emb": np.pad(emb, ((0, 0), more, (0, 0))),
                f"{prefix}_mask": np.pad(mask, [(0, 0)] * (mask.ndim - 1) + [more])}
  return widened | {"has_false": np.array(differ, bool)}


def with_text(batch: dict[str, Any], config: ConfigDict, encoder: TextEncoder, step: int, rows: slice = batches.ALL,
              vectors: bool = False) -> dict[str, Any]:
  """Replaces the captions of a batch by their embeddings: text_emb (B, S, E), text_mask (B, S).

  vectors: one vector a sentence, text_emb (B, E); of an encoder that gives words, the vector comes first and the words
  follow. With a weight config.loss.contrast also the embeddings of contradicting captions, see `contradictions_of`.
  """
  rng = batches.step_rng(config.seed, 2, step)
  captions = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]

  def encoded(captions):
    if vectors and encoder.level == "sentence":
      return encoder(captions, rows=rows)
    if vectors:
      return encoder.sentence_and_words(captions, min(config.data.max_words, encoder.max_words), rows)
    return encoder(captions, at_least=narrowest(config.data.max_words), rows=rows)

  text = dict(zip(("text_emb", "text_mask"), encoded(captions)))
  if config.loss.get("contrast", 0.0):
    false = contradicted(captions, config.seed, step)
    other = dict(zip(("text_emb", "text_mask"), encoded([false[caption] for caption in captions])))
    text = contradictions_of(text, other, [false[caption] != caption for caption in captions[rows]])
  if vectors and encoder.level == "sentence":
    text = {name: value for name, value in text.items() if not name.endswith("_mask")}
  return batch | text


# --- on held-out clips --------------------------------------------------------------------------------------------


def undisturbed(config: ConfigDict) -> ConfigDict:
  """A copy of a config without random dropping of captions, latents or activations."""
  given = config.copy_and_resolve_references().unlock()
  for section, name in _DISTURBED:
    if name in given[section]:
      given[section][name] = 0.0
  return given


def held_out_means(next_batch: Callable[[int], Any], measure: Callable[..., Any], frozen: Any,
                   names: Sequence[str] = ("loss",), num_batches: int = 4) -> Callable[[Any], dict[str, float]]:
  """evaluate(params): means, as held_out_NAME, over the same few batches with the same keys every time.

  measure(params, frozen, batch, key) -> sums by their names, and by "weight" the number to divide them by; a stage's
  `predict`, or of its loss `measured_loss`. It is compiled here.
  """
  compiled, batch = jax.jit(measure), functools.cache(next_batch)

  def evaluate(params):
    parts = [compiled(params, frozen, batch(i), jax.random.key(i)) for i in range(num_batches)]
    total = {name: sum(float(part[name]) for part in parts) for name in ("weight", *names) if name in parts[0]}
    return {f"held_out_{name}": round(value / total["weight"], 5) for name, value in total.items() if name != "weight"}

  return evaluate


def measured_loss(loss: Callable[..., Any]) -> Callable[..., Any]:
  """A stage's loss as a `measure` of `held_out_means`."""
  def measure(params, frozen, batch, key):
    sums, weight = loss(params, frozen, batch, 0, key)
    return {"loss": sums["loss"], "weight": weight}

  return measure


def held_out_loss(config: ConfigDict, stats: Stats, encoder: TextEncoder, loss: Callable[..., Any], frozen: Any
                  ) -> Callable[[Any], dict[str, float]] | None:
  """`held_out_means` of a stage's loss; None where no held-out clip is long enough."""
  try:
    next_batch, _ = batches_of(config, held_out(config, stats, captioned=True), encoder)
  except ValueError as error:
    print(f"note: no loss on held-out clips: {error}")
    return None
  return held_out_means(next_batch, measured_loss(loss), frozen)


def denoising_setup(config: ConfigDict, stage_of: Callable[[ConfigDict], Stage], data: sources.FeatureSet,
                    encoder: TextEncoder, frozen: dict[str, Any]) -> TrainingSetup:
  """The set-up of a denoiser: its stage on captioned clips, measured on held-out ones without dropping anything."""
  next_batch, num_items = batches_of(config, data, encoder)
  config = resolve_epochs(config, num_items)  # a loss may change towards the end of training
  evaluate = held_out_loss(config, data.stats, encoder, stage_of(undisturbed(config)).loss, frozen)
  return TrainingSetup(stage_of(config), next_batch, frozen, evaluate, data.stats, text_files(data, encoder), num_items)
