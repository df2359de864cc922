"""MLD's transformer VAE: one token for a whole motion.

  motion-jax train --config mld_vae --workdir runs/mld_vae --data HumanML3D
  ... --config mld_vae:kit                  KIT's 251 numbers; 67: HumanML3D's first 67
  ... --config mld_vae:v2                   MotionLCM's: 16 tokens of 32 numbers (docs/papers/mld.md#v2)
  ... --config mld_vae:small                on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; as in kit_tiny with a size behind. `full` is the released code's configuration
(docs/papers/mld.md#vae, #training), MLD-1: 18.0 M parameters, 6,000 epochs of batches of 128.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax.configs import common

SIZES = ("full", "small", "laptop", "tiny")
DATA = {"kit": (251, dict(layout="full_kit", min_frames=24)), "67": (67, dict(layout="essential"))}
KINDS = ("v2",)


def get_config(name="full"):
  size, data, kind = common.words_of(name, SIZES, DATA, KINDS)
  config = common.experiment("mld.vae", seed=1234)
  config.frozen = dict()
  config.model = dict(features=263, width=256, num_tokens=1, depth=9, num_heads=4, mlp_width=1024, dropout=0.1,
                      max_length=500, latent_width=0)
  config.loss = dict(features=1.0, joints=1.0, kl=1e-4)
  config.data = common.captioned_data(layout="full", batch_size=128, min_frames=40, max_frames=196,
                                      lengths=(64, 128, 196), balance=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, weight_decay=0.01)
  config.train = common.epochs(6_000, log_every=100, num_saves=30)
  if kind == "v2":
    config.model.update(num_tokens=16, latent_width=32)
  if data:
    config.model.features = DATA[data][0]
    config.data.update(DATA[data][1])
  if size in ("small", "laptop"):
    config.model.update(width=128, depth=5, mlp_width=384)
    common.archives(config, min_frames=20, batch_size=32, balance=0.5, lengths=(72, 120, 196))
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=1_000, clip_norm=1.0,
                            ema_decay=0.995)
    config.train.update(num_steps=4_000 if size == "laptop" else 12_000, log_every=20, save_every=500)
  elif size == "tiny":
    config.model.update(width=16, depth=3, num_heads=2, mlp_width=16)
    common.tiny(config)
  return config.lock()
