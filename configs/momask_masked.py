"""MoMask's masked transformer on codes of a trained RVQ-VAE; with a residual transformer it makes whole motions.

  motion-jax train --config momask_masked --workdir runs/momask --data HumanML3D --config.frozen.text=CLIP-FOLDER \
      --config.frozen.tokenizer=runs/momask_rvq --config.frozen.residual=runs/momask_residual
  ... --config momask_masked:kit      KIT's 21 joints; as in kit_tiny with a size behind
  ... --config momask_masked:snapmogen SnapMoGen's 296 numbers
  ... --config momask_masked:laptop   on archives, minutes on a laptop; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released command (docs/papers/momask.md#training): 12.0 M
parameters, 500 epochs.

Expected: `full` and `laptop` have not been run to their end.
"""
from motion_jax import paper_tables
from motion_jax.configs import common

PRINTED = {"": {"cmdm 1": "MoMask", "cmdm 6": "MoMask", "cdamd 1": "MoMask", "cdamd 6": "MoMask",
                "authors humanml3d": "MoMask"},
           "kit": {"cdamd 2": "MoMask", "authors kit": "MoMask"}, "snapmogen": {"cmdm 2": "MoMask"}}


def get_config(size="full"):
  return transformer("momask.masked", size)


def transformer(stage, name):
  """The config of one of the two transformers, which are trained alike."""
  data, size = common.data_and_size(name, ("kit", "snapmogen"), ("full", "laptop", "tiny"))
  config = common.experiment(stage, seed=3407)
  config.frozen = dict(tokenizer="runs/momask_rvq", text="clip-vit-base-patch32", text_level="sentence")
  config.tokenizer = dict(features=263, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2,
                          hide_padding=False)
  config.quantizer = dict(num_levels=6, num_codes=512)
  config.model = dict(num_codes=512, code_dim=512, width=384, depth=8, num_heads=6, ff_width=1024, text_dim=512,
                      dropout=0.2)
  config.loss = dict(noise_rate=0.1, mask_rate=0.88, drop_rate=0.1)
  config.data = common.captioned_data(layout="full", batch_size=64, min_frames=40, max_frames=196, lengths=(196,),
                                      balance=0.0, vary_subject=0.0, store="", feature_bias=25.0)
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(50_000,), gamma=0.1,
                                      warmup_steps=2_000, warmup="released", beta2=0.99, weight_decay=1e-5)
  config.train = common.epochs(500, log_every=100, num_saves=40)
  if stage == "momask.masked":
    config.frozen.update(residual="", length="")
    config.residual, config.length = dict(), dict()  # fields, which the run takes from the runs in frozen
    config.sampler = dict(num_iterations=10, guidance_scale=4.0, residual_scale=5.0)
    config.train.sample_every = 20_000
  else:
    config.model.update(num_levels=6, shared_tables=True)
    config.loss.drop_rate = 0.2
  if data == "kit":
    config.tokenizer.features, config.data.layout = 251, "full_kit"
    config.data.update(min_frames=24, batch_size=16)
    config.optimizer.boundaries = (20_000,)
    if stage == "momask.masked":
      config.sampler.guidance_scale = 2.0
  if data == "snapmogen":
    config.tokenizer.features = 296
    config.data.update(common.SNAPMOGEN | dict(lengths=(320,), keep_long=True, shorten_rate=0.0, feature_bias=0.0))
  if size == "laptop":
    config.frozen.text = "words"
    config.tokenizer.update(latent_dim=64, width=96, dropout=0.0, hide_padding=True)
    config.quantizer.update(num_levels=4, num_codes=256)
    config.model.update(num_codes=256, code_dim=64, width=192, depth=4, num_heads=4, ff_width=512, text_dim=384,
                        dropout=0.1)
    common.archives(config, batch_size=32, min_frames=20, lengths=(72, 120, 196), balance=0.5, vary_subject=0.5,
                    feature_bias=0.0)
    config.optimizer.update(learning_rate=1e-3, schedule="wsd", warmup_steps=50, warmup="full", cooldown_steps=900,
                            ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=3_000, log_every=10, save_every=500, sample_every=0)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", text="random-init")
    config.tokenizer.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.update(num_levels=3, num_codes=8)
    config.model.update(num_codes=8, code_dim=4, width=16, depth=1, num_heads=2, ff_width=16, text_dim=32)
    common.tiny(config, feature_bias=0.0)
  if stage == "momask.residual":
    config.model.num_levels = config.quantizer.num_levels
    return config.lock()
  return paper_tables.with_rows(config, PRINTED[data], exact=size == "full").lock()
