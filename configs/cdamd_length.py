"""MARDM's length estimator, for prompts that come without a length.

  python launch.py --config configs/cdamd_length.py --workdir runs/length --config.data.folder=HumanML3D \
      --config.frozen.text=CLIP-FOLDER
  ... --config configs/cdamd_length.py:kit        21 joints, 12.5 frames a second
  ... --config configs/cdamd_length.py:small      for the archives
  ... --config configs/cdamd_length.py:laptop     your own data in an afternoon, docs/your-own-data.md
  ... --config configs/cdamd_length.py:tiny       two steps on formulas, seconds; kit_tiny: of KIT's body

`full` is the released code's configuration (docs/papers/cdamd.md#length): 435,122 parameters, 300 epochs. A generator
takes it by --config.frozen.length=runs/length.
"""
import ml_collections


def get_config(size="full"):
  kit, size = size.startswith("kit"), size.removeprefix("kit").removeprefix("_") or "full"
  config = ml_collections.ConfigDict()
  config.stage = "cdamd.length"
  config.seed = 3407
  config.frozen = dict(text="clip-vit-base-patch32")
  config.model = dict(num_classes=50, width=512, dropout=0.2)
  config.loss = dict()
  config.data = dict(name="humanml3d", folder="", folders=(), layout="coordinates", mode="benchmark", mirror=False,
                     per_axis=False, batch_size=64, min_frames=40, max_frames=196, unit=4, lengths=(196,), balance=0.0,
                     vary_subject=0.0)
  config.optimizer = dict(learning_rate=1e-4, schedule="constant", boundaries=(), gamma=0.1, cooldown_steps=0,
                          warmup_steps=0, beta1=0.9, beta2=0.999, weight_decay=0.0, clip_norm=0.5, ema_decay=0.0,
                          skip_loss=0.0)
  config.train = dict(num_steps=108_000, log_every=100, save_every=5_000)
  if kit:
    config.data.update(layout="coordinates_kit", min_frames=24)
  if size in ("small", "laptop"):
    config.frozen.text = "words"
    config.data.update(name="archive", mode="corrected", mirror=True, min_frames=20, balance=0.5, vary_subject=0.5)
    config.train.update(num_steps=3_000, save_every=1_000)
    if size == "laptop":
      config.train.update(num_steps=1_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.frozen.text = "fresh"
    config.model.width = 16
    config.data.update(name="synthetic", mode="corrected", batch_size=4)
    config.train.update(num_steps=2, log_every=1, save_every=2)
  elif size != "full":
    raise ValueError(f"got size {size!r}, expected full, small, laptop or tiny, or kit before it")
  return config.lock()
