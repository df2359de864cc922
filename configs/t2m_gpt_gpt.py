"""T2M-GPT's transformer on codes of a trained VQ-VAE.

  motion-jax train --config t2m_gpt_gpt --workdir runs/t2m_gpt --data HumanML3D --config.frozen.text=CLIP-FOLDER \
      --config.frozen.tokenizer=runs/t2m_gpt_vq
  ... --config t2m_gpt_gpt:kit      KIT's 21 joints; as in kit_tiny with a size behind
  ... --config t2m_gpt_gpt:snapmogen SnapMoGen's 296 numbers
  ... --config t2m_gpt_gpt:laptop   on archives, minutes on a laptop; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released command (docs/papers/t2m_gpt.md#training): 228.4 M
parameters, batches of 128, 300,000 steps.

Expected: `full` and `laptop` have not been run to their end.
"""
from motion_jax import paper_tables
from motion_jax.configs import common

PRINTED = {"": {"cmdm 1": "T2M-GPT", "cmdm 6": "T2M-GPT", "authors humanml3d": "T2M-GPT"},
           "kit": {"authors kit": "T2M-GPT"}, "snapmogen": {"cmdm 2": "T2M-GPT"}}


def get_config(size="full"):
  data, size = common.data_and_size(size, ("kit", "snapmogen"), ("full", "laptop", "tiny"))
  config = common.experiment("t2m_gpt.gpt", seed=123)
  config.frozen = dict(tokenizer="runs/t2m_gpt_vq", text="clip-vit-base-patch32", text_level="sentence")
  config.tokenizer = dict(features=263, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.0,
                          hide_padding=False)
  config.quantizer = dict(num_levels=1, num_codes=512)
  config.model = dict(num_codes=512, width=1024, depth=18, num_heads=16, ff_width=4096, text_dim=512, max_length=51,
                      dropout=0.1)
  config.loss = dict(keep_rate=0.5)  # -1: a rate is drawn for each batch
  config.data = common.data(layout="full", batch_size=128, min_frames=40, max_frames=196, balance=0.0,
                            vary_subject=0.0, shorten_rate=1 / 3, feature_bias=25.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, schedule="step", boundaries=(150_000,), gamma=0.05,
                                      beta1=0.5, beta2=0.9, weight_decay=1e-6)
  config.train = common.train(300_000, log_every=100, save_every=20_000, sample_every=20_000)
  config.sampler = dict(guidance_scale=1.0, draw="categorical", temperature=1.0)
  if data == "kit":
    config.tokenizer.features, config.data.layout, config.data.min_frames = 251, "full_kit", 24
    config.loss.keep_rate = -1.0
  if data == "snapmogen":
    config.tokenizer.features, config.model.max_length = 296, 82  # 80 codes, the one that ends a motion, the caption
    config.data.update(common.SNAPMOGEN | dict(feature_bias=0.0))
  if size == "laptop":
    config.frozen.text = "words"
    config.tokenizer.update(latent_dim=64, width=96)
    config.quantizer.update(num_codes=256)
    config.model.update(num_codes=256, width=192, depth=6, num_heads=4, ff_width=512, text_dim=384)
    common.archives(config, batch_size=32, min_frames=20, balance=0.5, vary_subject=0.5, feature_bias=0.0)
    config.optimizer.update(learning_rate=1e-3, schedule="wsd", warmup_steps=50, cooldown_steps=900, beta1=0.9,
                            beta2=0.99, ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=3_000, log_every=10, save_every=500, sample_every=0)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", text="random-init")
    config.tokenizer.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.update(num_codes=8)
    config.model.update(num_codes=8, width=16, depth=2, num_heads=2, ff_width=16, text_dim=32)
    common.tiny(config, feature_bias=0.0)
  return paper_tables.with_rows(config, PRINTED[data], exact=size == "full").lock()
