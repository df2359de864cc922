"""CDAMD's deterministic autoencoder on absolute joint coordinates.

  motion-jax train --config cdamd_autoencoder --workdir runs/autoencoder --data HumanML3D
  ... --config cdamd_autoencoder:small     the size that ships, on archives; also laptop, mini, tiny
  ... --config cdamd_autoencoder:263       full features instead of coordinates (Table V); 67: essential ones, MARDM's
                                           own, and 64: those of KIT; kit: KIT's 21 joints, in millimetres; steps:
                                           coordinates whose pelvis goes by steps; snapmogen: SnapMoGen's 296 numbers;
                                           as in kit_tiny with a size behind

How sizes are written: docs/configs.md. `full` is the released code's configuration
(docs/papers/cdamd.md#autoencoder, #sizes): 18.8 M parameters, 50 epochs.

Expected: `full` has not been run. `small`: 38 minutes of one shared core of an AMD EPYC; 36.4 mm of joint error on
held-out windows (pretrained/cdamd-small/README.md). `mini`, cut to 500 steps: 92 to 94 mm, one to two minutes
(docs/benchmark/study_cdamd.md).
"""
from motion_jax.configs import common

# Columns, layout, and the columns that count twice.
DATA = {"kit": (63, "coordinates_kit", (4, 64)), "64": (64, "essential_kit", (4, 64)),
        "67": (67, "essential", (4, 67)), "263": (263, "full", (4, 67)), "steps": (70, "steps", (0, 3)),
        "snapmogen": (296, "snapmogen", (148, 220))}


def get_config(size="full"):
  data, size = common.data_and_size(size, DATA, ("full", "small", "laptop", "mini", "tiny"))
  config = common.experiment("cdamd.autoencoder", seed=3407)
  config.frozen = dict()
  config.model = dict(features=66, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2,
                      decoder_width=0)  # of the decoder, if it has a width of its own
  # columns: those that count twice, 4 : 4 + 3 (J - 1). distance "l1" with position_weight 0 is the paper's loss.
  # latent_noise: of what the decoder is given in training, in standard deviations of the latents.
  config.loss = dict(distance="smooth_l1", position_weight=1.0, columns=(4, 67), latent_noise=0.0,
                     **common.motion_errors(), **common.critic())
  # per_axis: one mean and std for x, y and z each over all joints, instead of one per column. balance: windows of rare
  # actions are drawn more often; 0 each once an epoch, 1 all actions alike.
  config.data = common.data(layout="coordinates", per_axis=False, batch_size=256, window=64, stride=1,
                            released_windows=False, one_per_clip=False, short_window=0, balance=0.0)
  # Parity: the reference counts 150,000 and 250,000 from the end of the warm-up.
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(152_000, 252_000), gamma=0.05,
                                      warmup_steps=2_000, beta2=0.99)
  config.train = common.epochs(50, log_every=100, num_saves=50, sample_every=50_000)
  if data:
    config.model.features, config.data.layout, config.loss.columns = DATA[data]
  if data == "snapmogen" and size == "full":
    config.data.name = "snapmogen"
  if data in ("kit", "64"):
    config.data.batch_size = 512
    config.optimizer.gamma = 0.1
  if size in ("small", "mini", "laptop"):
    config.model.update(latent_dim=64, width=192, dropout=0.0)  # a small model has no capacity to spare
    config.loss.distance = "l1"  # the paper's: squares of what is small beside a path of metres teach no pose
    common.archives(config, batch_size=32, stride=4)
    config.optimizer.update(learning_rate=8e-4, schedule="wsd", warmup_steps=200, cooldown_steps=2_500,
                            clip_norm=1.0, ema_decay=0.999)
    config.train.update(num_steps=9_000, log_every=50, save_every=1_000)
    if size in ("mini", "laptop"):
      config.model.update(width=128)
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300, ema_decay=0.99)
      config.train.update(num_steps=900, save_every=450)
    if size == "laptop":
      config.optimizer.update(cooldown_steps=900, ema_decay=0.995)
      config.train.update(num_steps=3_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.model.update(latent_dim=4, width=16, dilations=(1,))
    common.tiny(config)
    if data in ("kit", "64"):
      config.data.window = 32  # 12.5 frames a second
    config.optimizer.update(warmup_steps=1)
  return config.lock()
