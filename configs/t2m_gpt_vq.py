"""T2M-GPT's VQ-VAE: motion to one code for every four frames.

  motion-jax train --config t2m_gpt_vq --workdir runs/t2m_gpt_vq --data HumanML3D
  ... --config t2m_gpt_vq:kit      KIT's 21 joints; as in kit_tiny with a size behind
  ... --config t2m_gpt_vq:snapmogen SnapMoGen's 296 numbers
  ... --config t2m_gpt_vq:laptop   on archives, minutes on a laptop; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released command (docs/papers/t2m_gpt.md#vq-vae): 19.4 M
parameters, batches of 256, 999 steps of warm-up before 300,000 more.

Expected: `full` and `laptop` have not been run to their end.
"""
from motion_jax.configs import common

DATA = {"": (263, "full", (4, 67)), "kit": (251, "full_kit", (4, 64)),
        "snapmogen": (296, "snapmogen", (148, 220))}


def get_config(size="full"):
  data, size = common.data_and_size(size, ("kit", "snapmogen"), ("full", "laptop", "tiny"))
  features, layout, columns = DATA[data]
  config = common.experiment("t2m_gpt.vq", seed=123)
  config.frozen = dict()
  config.model = dict(features=features, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.0)
  # temperature 0: always the nearest code.
  config.quantizer = dict(num_levels=1, num_codes=512, decay=0.99, temperature=0.0, drop_rate=0.0, gain_once=False,
                          learn="means")
  config.loss = dict(distance="smooth_l1", position_weight=0.5, columns=columns, velocity_weight=0.0,
                     commitment_weight=0.02, **common.motion_errors())
  config.data = common.data(layout=layout, batch_size=256, window=64, stride=1, released_windows=False,
                            one_per_clip=True, short_window=0, balance=0.0, feature_bias=25.0)
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(200_999,), gamma=0.05,
                                      warmup_steps=1_000, warmup="released", beta2=0.99)
  config.train = common.train(300_999, log_every=100, save_every=20_000)
  if data == "snapmogen":
    config.data.update(name=data, feature_bias=0.0)
  if size == "laptop":
    config.model.update(latent_dim=64, width=96)
    config.quantizer.update(num_codes=256)
    common.archives(config, batch_size=32, stride=4, one_per_clip=False, feature_bias=0.0)
    config.optimizer.update(learning_rate=1e-3, schedule="wsd", warmup_steps=50, warmup="full", cooldown_steps=600,
                            ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=2_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.model.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.update(num_codes=8)
    common.tiny(config, feature_bias=0.0)
  return config.lock()
