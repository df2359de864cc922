"""MotionStreamer's transformer with its diffusion head, on latents of a trained causal autoencoder.

  motion-jax train --config motionstreamer_generator --workdir runs/streamer --data HUMANML3D-272 \
      --config.frozen.tokenizer=runs/tae --config.frozen.text=SENTENCE-T5-FOLDER
  ... --config motionstreamer_generator:263     HumanML3D's 263 numbers at 20 frames a second; kit: KIT's 251
  ... --config motionstreamer_generator:small   on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; as in kit_tiny with a size behind. `full` is the released code's configuration
(docs/papers/motionstreamer.md#transformer, #two-forward): 242.3 M parameters, 100,000 steps of 256.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax import paper_tables
from motion_jax.configs import common, motionstreamer_tokenizer

SIZES, DATA = motionstreamer_tokenizer.SIZES, motionstreamer_tokenizer.DATA
PRINTED = {"": {"cmdm 1": "MotionStreamer", "cmdm speed": "MotionStreamer"}, "snapmogen": {"cmdm 2": "MotionStreamer"}}


def get_config(name="full"):
  size, data = common.words_of(name, SIZES, DATA)
  config = common.experiment("motionstreamer.generator", seed=123)
  config.frozen = dict(tokenizer="runs/tae", text="sentence-t5-xxl", text_level="sentence")
  config.tokenizer = motionstreamer_tokenizer.get_config(name).model.to_dict()
  config.model = dict(transformer=dict(latent_dim=16, width=768, depth=12, num_heads=12, text_dim=768, max_length=78),
                      head=dict(width=1792, depth=9))
  config.diffusion = dict(num_steps=50)
  # copies: rows at the head for each latent. crop_rate: sequences that lose their first or last latent. mean_latents:
  # the encoder's means instead of draws. replace_ramp: steps after which the transformer reads only latents of its own
  # making, as it does in sampling; 0: train.num_steps, so that a run that is stopped early has learned from true ones.
  config.loss = dict(drop_rate=0.1, copies=4, crop_rate=1 / 3, mean_latents=False, unit_latents=False, replace_ramp=0)
  layout = DATA[data or ("272" if size == "full" else "263")][1]
  frames = 300 if layout == "motionstreamer" else 196
  config.data = common.captioned_data(layout=layout, batch_size=256, min_frames=60 if frames == 300 else 40,
                                      max_frames=frames, lengths=(frames,), max_words=64, balance=0.0, vary_subject=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, schedule="cosine", warmup_steps=10_000, beta2=0.99,
                                      weight_decay=1e-6)
  config.train = common.train(100_000, log_every=100, save_every=10_000, sample_every=10_000)
  config.sampler = dict(guidance_scale=4.0, num_steps=50)
  if data == "kit":
    config.data.min_frames = 24
  if data == "snapmogen":
    config.model.transformer.max_length = 82  # 80 latents, the one that ends a motion, the caption
    config.data.update(common.SNAPMOGEN | dict(lengths=(320,), keep_long=True, shorten_rate=0.0))
  if size in ("small", "laptop"):
    config.frozen.text = "words"
    config.model.transformer.update(width=256, depth=6, num_heads=4, text_dim=384)
    config.model.head.update(width=400, depth=6)
    config.loss.update(unit_latents=True, copies=2)
    common.archives(config, min_frames=20, batch_size=32, balance=0.5, vary_subject=0.5, max_words=24)
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=900, ema_decay=0.995,
                            clip_norm=1.0)
    config.train.update(num_steps=3_000 if size == "laptop" else 12_000, log_every=20, save_every=500,
                        sample_every=1_500)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", text="random-init")  # nothing to download
    config.model.transformer.update(latent_dim=4, width=16, depth=1, num_heads=2, text_dim=32)
    config.model.head.update(width=16, depth=1)
    config.diffusion.num_steps = config.sampler.num_steps = 4
    common.tiny(config)
    config.optimizer.update(warmup_steps=1, schedule="constant")
  return paper_tables.with_rows(config, PRINTED.get(data, {}), exact=size == "full").lock()
