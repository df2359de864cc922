"""Training set-ups of T2M-GPT: its VQ-VAE, and the transformer on codes that are made once, before training."""
from ml_collections import ConfigDict

from motion_jax.data import batches, sources
from motion_jax.latents import TOKENIZER, RvqCodec
from motion_jax.models.shared.autoencoder_setup import load_codes, rvq
from motion_jax.models.shared.captioned_batches import (
  check_captions,
  held_out_means,
  text_encoder,
  text_files,
  with_text,
)
from motion_jax.models.t2m_gpt.items import CodeItems, encode_clips
from motion_jax.models.t2m_gpt.stages import gpt_stage
from motion_jax.training.setup import TrainingSetup, held_out


def gpt(config: ConfigDict) -> TrainingSetup:
  """The transformer on codes of a trained VQ-VAE."""
  net, variables, stats = load_codes(config, "t2m_gpt.vq")
  data = sources.load_features(config.data, stats=stats)
  encoder = text_encoder(config, config.model.text_dim, "sentence")
  codec, stage = RvqCodec(net, variables), gpt_stage(config)
  next_batch, num_items = _rows(config, data, codec, encoder)
  held, _ = _rows(config, held_out(config, stats, captioned=True), codec, encoder)
  evaluate = held_out_means(held, stage.predict, {}, ("loss", "accuracy"))
  return TrainingSetup(stage, next_batch, {TOKENIZER: variables}, evaluate, data.stats, text_files(data, encoder),
                       num_items)


def _rows(config, data, codec, encoder):
  """(next_batch, how many clips there are): rows of codes with the sentence vectors of their captions."""
  check_captions(data, encoder)
  least, most = config.data.min_frames, config.data.max_frames + 3  # Parity: "< 200", then cut to whole codes
  kept = [i for i, x in enumerate(data.features) if least <= len(x) <= most and data.captions[i]]
  if not kept:
    raise ValueError(f"none of {len(data.features)} clips has {least} to {most} frames and a caption")
  weights = data.draw_weights(config.data, kept)
  codes = encode_clips(codec, [data.features[i] for i in kept], config.seed)
  items = CodeItems(codes, [data.captions[i] for i in kept], config.model.max_length, config.model.num_codes,
                    config.data.shorten_rate, weights)

  def next_batch(step, rows=batches.ALL):
    batch = items.batch(config.data.batch_size, config.seed, step, rows)
    return with_text(batch, config, encoder, step, rows, vectors=True)

  return next_batch, len(items)


SETUPS = {"t2m_gpt.vq": rvq, "t2m_gpt.gpt": gpt}
