"""MARDM's length estimator, for prompts that come without a length.

  motion-jax train --config cdamd_length --workdir runs/length --data HumanML3D --config.frozen.text=CLIP-FOLDER
  ... --config cdamd_length:small     the size that ships, on archives; also laptop, tiny
  ... --config cdamd_length:kit       KIT's 21 joints, 12.5 frames a second; as in kit_tiny with a size behind

How sizes are written: docs/configs.md. `full` is the released code's configuration (docs/papers/cdamd.md#length):
435,122 parameters, 300 epochs. A generator takes it by --config.frozen.length=runs/length.

Expected: `full` has not been run. `small`: 2 minutes of one shared core of an AMD EPYC; 3.4 latents off on held-out
captions (pretrained/cdamd-small/README.md).
"""
from motion_jax.configs import common


def get_config(size="full"):
  data, size = common.data_and_size(size, ("kit",), ("full", "small", "laptop", "tiny"))
  config = common.experiment("cdamd.length", seed=3407)
  config.frozen = dict(text="clip-vit-base-patch32")
  config.model = dict(num_classes=50, width=512, dropout=0.2)
  config.loss = dict()
  config.data = common.data(layout="coordinates", per_axis=False, batch_size=64, min_frames=40, max_frames=196,
                            frames_per_latent=4, lengths=(196,), balance=0.0, vary_subject=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, clip_norm=0.5)
  config.train = common.epochs(300, log_every=100, num_saves=20)
  if data:
    config.data.update(layout="coordinates_kit", min_frames=24)
  if size in ("small", "laptop"):
    config.frozen.text = "words"
    common.archives(config, min_frames=20, balance=0.5, vary_subject=0.5)
    config.train.update(num_steps=3_000, save_every=1_000)
    if size == "laptop":
      config.train.update(num_steps=1_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.frozen.text = "random-init"
    config.model.width = 16
    common.tiny(config)
  return config.lock()
