"""MotionStreamer's causal autoencoder.

  motion-jax train --config motionstreamer_tokenizer --workdir runs/tae --data HUMANML3D-272
  ... --config motionstreamer_tokenizer:263     HumanML3D's 263 numbers at 20 frames a second; kit: KIT's 251
  ... --config motionstreamer_tokenizer:small   on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; as in kit_tiny with a size behind. `full` is the released code's configuration
(docs/papers/motionstreamer.md#autoencoder): 76.2 M parameters, 2,000,000 steps of 128 windows.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax.configs import common

SIZES = ("full", "small", "laptop", "tiny")
# Numbers a frame, layout.
DATA = {"272": (272, "motionstreamer"), "263": (263, "full"), "kit": (251, "full_kit"), "67": (67, "essential"),
        "snapmogen": (296, "snapmogen")}


def get_config(name="full"):
  size, data = common.words_of(name, SIZES, DATA)
  config = common.experiment("motionstreamer.tokenizer", seed=123)
  config.frozen = dict()
  features, layout = DATA[data or ("272" if size == "full" else "263")]
  config.model = dict(features=features, latent_dim=16, width=1024, num_halvings=2, dilations=(9, 3, 1))
  # micro_batch: windows that share a sigma; the released code's are those of one device.
  config.loss = dict(kl_weight=1.0, root_weight=7.0, micro_batch=128)
  config.data = common.data(layout=layout, batch_size=128, window=64, stride=1, balance=0.0)
  config.optimizer = common.optimizer(learning_rate=5e-5, schedule="step", boundaries=(1_901_000,), gamma=0.05,
                                      warmup_steps=1_000, beta2=0.99)
  config.train = common.train(2_001_000, log_every=200, save_every=20_000, sample_every=100_000)
  if data == "snapmogen":
    config.data.name = data
  if size in ("small", "laptop"):
    config.model.update(width=192)
    common.archives(config, stride=4)
    config.data.update(batch_size=32)
    config.loss.micro_batch = 32
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=900, clip_norm=1.0,
                            ema_decay=0.995)
    config.train.update(num_steps=3_000 if size == "laptop" else 12_000, log_every=10, save_every=500, sample_every=0)
  elif size == "tiny":
    config.model.update(latent_dim=4, width=16, dilations=(1,))
    config.loss.micro_batch = 2
    common.tiny(config)
    if data == "kit":
      config.data.window = 32  # 12.5 frames a second
  return config.lock()
