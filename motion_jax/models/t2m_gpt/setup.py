"""Training set-ups of T2M-GPT: its VQ-VAE, and the transformer on codes that are made once, before training."""
import jax
from ml_collections import ConfigDict

from motion_jax.data import batches, sources
from motion_jax.latents import TOKENIZER, RvqCodec
from motion_jax.models.autoencoder_setup import load_frozen, rvq
from motion_jax.models.t2m_gpt.items import CodeItems, encode_clips
from motion_jax.models.t2m_gpt.stages import gpt_stage
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import TrainingSetup, caption_lengths, encoder_files, held_out


def gpt(config: ConfigDict) -> TrainingSetup:
  """The transformer on codes of a trained VQ-VAE."""
  if config.model.num_codes != config.quantizer.num_codes:
    raise ValueError(f"got model.num_codes = {config.model.num_codes}, the quantizer has {config.quantizer.num_codes} "
                     "codes; make them agree")
  net, variables, stats = load_frozen(config.frozen.tokenizer, config.tokenizer, "t2m_gpt.vq", config, config.quantizer)
  data = sources.load_features(config.data, stats=stats)
  encoder = load_text_encoder(config.frozen.text, level="sentence")
  if encoder.dim != config.model.text_dim:
    raise ValueError(f"text encoder {config.frozen.text!r} gives {encoder.dim} numbers a sentence, the model takes "
                     f"model.text_dim = {config.model.text_dim}; make them agree")
  codec, stage = RvqCodec(net, variables), gpt_stage(config)
  next_batch, num_items = _rows(config, data, codec, encoder)
  files = {checkpoint.LENGTHS: caption_lengths(data), **encoder_files(encoder)}
  held, _ = _rows(config, held_out(config, stats, captioned=True), codec, encoder)
  predict = jax.jit(stage.predict)

  def evaluate(params):
    parts = [predict(params, {}, held(i), jax.random.key(0)) for i in range(4)]
    total = {name: sum(float(part[name]) for part in parts) for name in parts[0]}
    return {f"held_out_{name}": round(total[name] / total["weight"], 5) for name in ("loss", "accuracy")}

  return TrainingSetup(stage, next_batch, {TOKENIZER: variables}, evaluate, data.stats, files, num_items)


def _rows(config, data, codec, encoder):
  """(next_batch, how many clips there are): rows of codes with the sentence vectors of their captions."""
  encoder.check(caption for captions in data.captions for caption in captions)
  least, most = config.data.min_frames, config.data.max_frames + 3  # Parity: "< 200", then cut to whole codes
  kept = [i for i, x in enumerate(data.features) if least <= len(x) <= most and data.captions[i]]
  if not kept:
    raise ValueError(f"none of {len(data.features)} clips has {least} to {most} frames and a caption")
  groups = [data.groups[i] for i in kept]
  weights = batches.balance_weights(groups, config.data.balance) if config.data.balance else None
  codes = encode_clips(codec, [data.features[i] for i in kept], config.seed)
  items = CodeItems(codes, [data.captions[i] for i in kept], config.model.max_length, config.model.num_codes,
                    config.data.shorten_rate, weights)

  def next_batch(step, rows=batches.ALL):
    batch = items.batch(config.data.batch_size, config.seed, step, rows)
    rng = batches.step_rng(config.seed, 2, step)
    said = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]
    return batch | {"text_emb": encoder(said, rows=rows)[0]}

  return next_batch, len(items)


RESOLVED: dict = {}
SETUPS = {"t2m_gpt.vq": rvq, "t2m_gpt.gpt": gpt}
