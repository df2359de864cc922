"""MoMask's RVQ-VAE: motion to six codes for every four frames.

  motion-jax train --config momask_rvq --workdir runs/momask_rvq --data HumanML3D
  ... --config momask_rvq:snapmogen SnapMoGen's 296 numbers
  ... --config momask_rvq:kit      KIT's 21 joints; as in kit_tiny with a size behind
  ... --config momask_rvq:laptop   on archives, minutes on a laptop; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released command (docs/papers/momask.md#rvq): 19.4 M parameters
and 1.6 M numbers in the codebooks, windows of 64 frames, 50 epochs of some 7,000 steps, for KIT 500 epochs.

Expected: `full` and `laptop` have not been run to their end.
"""
from motion_jax.configs import common

# Columns, layout, the columns that count twice (joint positions), quantize dropout, epochs, batch, milestone factor.
DATA = {"": (263, "full", (4, 67), 0.2, 50, 256, 0.05), "kit": (251, "full_kit", (4, 64), 0.5, 500, 512, 0.1),
        "snapmogen": (296, "snapmogen", (148, 220), 0.2, 50, 256, 0.05)}


def get_config(size="full"):
  data, size = common.data_and_size(size, ("kit", "snapmogen"), ("full", "laptop", "tiny"))
  features, layout, columns, drop_rate, epochs, batch_size, gamma = DATA[data]
  config = common.experiment("momask.rvq", seed=3407)
  config.frozen = dict()
  config.model = dict(features=features, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2)
  config.quantizer = dict(num_levels=6, num_codes=512, decay=0.99, temperature=0.5, drop_rate=drop_rate,
                          gain_once=False, learn="means")
  config.loss = dict(distance="smooth_l1", position_weight=0.5, columns=columns, velocity_weight=0.0,
                     commitment_weight=0.02, **common.motion_errors())
  config.data = common.data(layout=layout, batch_size=batch_size, window=64, stride=1, released_windows=True,
                            one_per_clip=False, short_window=0, balance=0.0, feature_bias=25.0)
  # Parity: the code's scheduler counts from the end of the warm-up, which begins with the second step.
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(151_999, 251_999), gamma=gamma,
                                      warmup_steps=2_000, warmup="released", beta2=0.99)
  config.train = common.epochs(epochs, log_every=50, num_saves=10)
  if data == "snapmogen":
    config.data.update(name=data, feature_bias=0.0)
  if size == "laptop":
    config.model.update(latent_dim=64, width=96, dropout=0.0)
    config.quantizer.update(num_levels=4, num_codes=256)
    common.archives(config, batch_size=32, stride=4, released_windows=False, feature_bias=0.0)
    config.optimizer.update(learning_rate=1e-3, schedule="wsd", warmup_steps=50, warmup="full", cooldown_steps=600,
                            ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=2_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.model.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.update(num_levels=3, num_codes=8)
    common.tiny(config, released_windows=False, feature_bias=0.0)
  return config.lock()
