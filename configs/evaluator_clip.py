"""The CLIP-type evaluator: motions and sentences as directions of one space, for the CLIP score.

  motion-jax train --config evaluator_clip --workdir runs/clip --data HumanML3D \
      --config.frozen.text=clip-vit-base-patch16
  ... --config evaluator_clip:66        absolute coordinates (CDAMD); full: 259 of 263 features; kit: KIT-ML, 64: its
                                        essential features, 63: coordinates
  ... --config evaluator_clip:small     the one that ships, on archives, word pieces of the encoder that ships; also
                                        laptop, tiny

How sizes are written: docs/configs.md. `67`, the default, is MARDM's network (docs/papers/cdamd.md#clip-evaluator):
59.5 M parameters, 34.2 M without CLIP's table of word pieces, which is held still. How it was trained is published
nowhere; optimizer, batch and number of steps (150 epochs) are ours. The weights of the best validation retrieval are
kept.

Expected: none but `small` has been run: 27 minutes on a quarter of a shared core; of 117 captions of the val rows
46.2 % find their motion first, 86.3 % among three (pretrained/clip-evaluator-small/README.md).
"""
from motion_jax.configs import common


def get_config(size="67"):
  size, layout, columns, features = common.evaluated_size(size)
  config = common.experiment("evaluator.clip", seed=0)
  config.frozen = dict(text="clip-vit-base-patch16")  # whose word pieces and tables are read
  config.model = dict(features=features, columns=columns, width=512, depth=8, num_heads=8, mlp_width=1024, dim=512,
                      vocab_size=49_408, max_words=77, dropout=0.2)
  config.loss = dict()
  # same: as in configs/evaluator_matching.py.
  config.data = common.captioned_data(layout=layout, per_axis=False, batch_size=128, min_frames=40, max_frames=196,
                                      lengths=(196,), same="caption")
  config.optimizer = common.optimizer(learning_rate=1e-4, schedule="cosine", warmup_steps=1_000, weight_decay=0.01,
                                      clip_norm=1.0)
  config.train = common.epochs(150, log_every=50, num_saves=30, best="max recall")
  if size in common.KIT_EVALUATED:
    config.data.min_frames = 24
  elif size in ("small", "laptop"):
    config.frozen.text = "words"
    config.model.update(width=128, depth=2, num_heads=4, mlp_width=256, dim=128, vocab_size=6_502, max_words=24,
                        dropout=0.0)
    common.archives(config, batch_size=64, min_frames=20,
                       lengths=(64, 112, 196), same="meaning")
    config.optimizer.update(learning_rate=1e-3, warmup_steps=50, ema_decay=0.98)
    config.train.update(num_steps=450, save_every=75)
    if size == "laptop":
      config.train.update(num_steps=300, log_every=10, save_every=75)
  elif size == "tiny":
    config.frozen.text = "random-init"
    config.model.update(width=32, depth=1, num_heads=2, mlp_width=16, dim=8, vocab_size=97, max_words=64)
    common.tiny(config, max_frames=96, lengths=(96,), same="meaning")
  return config.lock()
