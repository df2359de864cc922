"""CDAMD's RVQ-VAE, whose codes are the motion prior of the masked transformer while it trains.

  motion-jax train --config cdamd_rvq --workdir runs/rvq --data HumanML3D
  ... --config cdamd_rvq:small     the size behind what ships, on archives; also laptop, mini, tiny
  ... --config cdamd_rvq:263       full features instead of coordinates (Table V); 67: essential ones; kit: KIT's 21
                                   joints, in millimetres; steps: coordinates whose pelvis goes by steps; as in
                                   kit_tiny with a size behind

How sizes are written: docs/configs.md. `full` is the released code's configuration (docs/papers/cdamd.md#rvq, #sizes):
18.8 M parameters and 1.0 M numbers in the codebooks, on whole clips padded to 196 frames, 50 epochs of some 90
steps. With --config.data.window=64 it sees windows of the clips instead.

Expected: `full` has not been run. `small`: 8 minutes of one shared core of an AMD EPYC; its error was not recorded.
`mini`, cut to 250 steps: 119 to 138 mm held out, under a minute (docs/benchmark/study_cdamd.md).
"""
from motion_jax.configs import common

# Columns, layout, and the columns that count twice.
# Parity: here the code takes all columns from 4 on, in the autoencoder 4:67.
DATA = {"kit": (63, "coordinates_kit", (4, 64)), "67": (67, "essential", (4, 67)), "263": (263, "full", (4, 263)),
        "steps": (70, "steps", (0, 3))}


def get_config(size="full"):
  data, size = common.data_and_size(size, DATA, ("full", "small", "laptop", "mini", "tiny"))
  config = common.experiment("cdamd.rvq", seed=3407)
  config.frozen = dict()
  config.model = dict(features=66, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2)
  # drop_rate: quantize dropout, per batch. gain_once: straight-through gradient once, not once per active level.
  # learn: codebooks by running "means" or, as the paper has it, by "gradient".
  config.quantizer = dict(num_levels=4, num_codes=512, decay=0.99, temperature=0.5, drop_rate=0.2, gain_once=False,
                          learn="means")
  config.loss = dict(distance="smooth_l1", position_weight=0.1, columns=(4, 67), velocity_weight=0.1,
                     commitment_weight=0.02, **common.motion_errors())
  # window 0: whole clips of min_frames to max_frames frames, padded with zeros.
  config.data = common.data(layout="coordinates", per_axis=False, batch_size=256, window=0, stride=1,
                            released_windows=False, one_per_clip=False, short_window=0, balance=0.0, min_frames=40,
                            max_frames=196)
  # Parity: the reference counts 150,000 and 250,000 from the end of the warm-up.
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(152_000, 252_000), gamma=0.05,
                                      warmup_steps=2_000, beta2=0.99)
  config.train = common.epochs(50, log_every=50, num_saves=10)
  if data:
    config.model.features, config.data.layout, config.loss.columns = DATA[data]
  if data == "kit":
    config.data.min_frames = 24
  if size in ("small", "mini", "laptop"):
    config.model.update(latent_dim=64, width=128, dropout=0.0)
    config.quantizer.update(num_codes=256)
    config.loss.distance = "l1"  # as the autoencoder's
    # Windows: no arithmetic on padding, and no codes spent on it.
    common.archives(config, batch_size=32, window=64, stride=4)
    config.optimizer.update(learning_rate=6e-4, schedule="wsd", warmup_steps=200, cooldown_steps=1_000,
                            clip_norm=1.0)
    config.train.update(num_steps=3_000, log_every=50, save_every=1_000)
    if size in ("mini", "laptop"):
      config.model.update(width=96)
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300)
      config.train.update(num_steps=900, save_every=450)
    if size == "laptop":
      config.optimizer.update(cooldown_steps=600, ema_decay=0.995)
      config.train.update(num_steps=2_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.model.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.update(num_codes=8)
    common.tiny(config, min_frames=20)
    config.optimizer.update(warmup_steps=1)
  return config.lock()
