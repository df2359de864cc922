"""The benchmarks' evaluator, second half: motions and sentences matched in one Euclidean space.

  motion-jax train --config evaluator_matching --workdir runs/evaluator --data HumanML3D \
      --config.frozen.movement=runs/movement --config.frozen.glove=glove
  ... --config evaluator_matching:66        absolute coordinates (CDAMD); 67: essential features; kit: KIT-ML, 64: its
                                            essential features, 63: coordinates
  ... --config evaluator_matching:small     the one that ships, on archives, words of the encoder that ships; also
                                            laptop, tiny

How sizes are written: docs/configs.md. `full` is the original's (docs/papers/cdamd.md#matching-evaluator): 21.7 M
parameters with the movement encoder of evaluator_movement, which is held still; 300 epochs; the weights of the best
validation loss are kept. frozen.glove is the folder with the benchmark's our_vab_* files; empty, words are those of the
encoder frozen.text.

Expected: `full` has not been run. `small`: 20 minutes on a third of a shared core; of 117 captions of the val
rows 51.3 % find their motion first, 93.2 % among three (pretrained/evaluator-small/README.md).
"""
from motion_jax.configs import common


def get_config(size="full"):
  size, layout, columns, features = common.evaluated_size(size)
  config = common.experiment("evaluator.matching", seed=0)
  config.frozen = dict(movement="runs/movement", glove="", text="words")
  config.model = dict(features=features, columns=columns, movement_width=512, movement_dim=512, motion_width=1024,
                      text_width=512, dim=512)
  # first_shift 1 never takes right pairs for wrong ones, as the original does one time in batch_size - 1.
  config.loss = dict(margin=10.0, first_shift=0)
  # same: "" every other row is a wrong one, "caption" not those of the same words, "meaning" not those either whose
  # words stand with the same clips.
  config.data = common.captioned_data(layout=layout, per_axis=False, batch_size=32, min_frames=40, max_frames=196,
                                      lengths=(196,), max_words=20, same="")
  # clip_parts: each is clipped by the norm of its own gradient.
  config.optimizer = common.optimizer(learning_rate=1e-4, clip_norm=0.5, clip_parts=("motion_encoder", "text_encoder"))
  config.train = common.epochs(300, log_every=50, num_saves=300, best="min held_out_loss")
  if size in common.KIT_EVALUATED:
    config.data.min_frames = 24
  elif size in ("small", "laptop"):
    config.model.update(movement_width=128, movement_dim=128, motion_width=192, text_width=128, dim=128)
    config.loss.first_shift = 1
    # Template captions repeat: a motion of the same meaning is no wrong one.
    common.archives(config, min_frames=20, same="meaning")
    config.optimizer.update(learning_rate=1e-3, schedule="cosine", warmup_steps=100)
    config.train.update(num_steps=2_500, save_every=250)
    if size == "laptop":
      config.train.update(num_steps=1_500, log_every=10, save_every=250)
  elif size == "tiny":
    config.frozen.update(movement="random-init", text="random-init")
    config.model.update(movement_width=12, movement_dim=12, motion_width=12, text_width=12, dim=8)
    common.tiny(config, max_frames=96, lengths=(96,), same="meaning")
  return config.lock()
