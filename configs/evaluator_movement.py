"""The benchmarks' evaluator, first half: an autoencoder whose encoder makes tokens of 4 frames.

  motion-jax train --config evaluator_movement --workdir runs/movement --data HumanML3D
  ... --config evaluator_movement:66        absolute coordinates (CDAMD); 67: essential features; kit: KIT-ML, 64: its
                                            essential features, 63: coordinates
  ... --config evaluator_movement:small     the one that ships: coordinates, on archives; also laptop, tiny

How sizes are written: docs/configs.md. evaluator_matching starts from it. `full` is the original's
(docs/papers/cdamd.md#matching-evaluator): 259 of 263 features, 270 epochs, of about 18,700 steps each.

Statistics are the data's own. The original's std of heading, root and contacts is divided by 5 (CMDM's by 25), which
weighs them more; released weights bring theirs.

Expected: `full` has not been run. `small`: 9.5 minutes on a third of a shared core; what comes of it is
evaluator_matching's to say.
"""
from motion_jax.configs import common


def get_config(size="full"):
  size, layout, columns, features = common.evaluated_size(size)
  config = common.experiment("evaluator.movement", seed=0)
  config.frozen = dict()
  config.model = dict(features=features, columns=columns, width=512, dim=512, dropout=0.2)
  config.loss = dict(size=0.001, change=0.001)  # weights of mean |token| and of mean |token - the one before|
  config.data = common.data(layout=layout, per_axis=False, batch_size=128, window=40, stride=1)
  config.optimizer = common.optimizer(learning_rate=1e-4)
  config.train = common.epochs(270, log_every=100, num_saves=270)
  if size in ("small", "laptop"):
    config.model.update(width=128, dim=128, dropout=0.0)
    common.archives(config, batch_size=64, stride=4)
    config.optimizer.update(learning_rate=1e-3, schedule="cosine", warmup_steps=100, clip_norm=1.0)
    config.train.update(num_steps=1_200, log_every=50, save_every=600)
    if size == "laptop":
      config.train.update(num_steps=1_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.model.update(width=12, dim=12)
    common.tiny(config)
  return config.lock()
