"""SnapMoGen's evaluator: a Gaussian for every motion and sentence, trained as TMR is.

  motion-jax train --config evaluator_snapmogen --workdir runs/snap --data SnapMoGen
  ... --config evaluator_snapmogen:small   narrow, with the text encoder that ships; also tiny

How sizes are written: docs/configs.md. Network, features 0:148 and text (T5 v1.1 base, 120 tokens) are SnapMoGen's
(docs/papers/cmdm.md#snapmogen). Losses and their weights are SnapMoGen's, which are TMR's; optimizer and number of
steps are ours. The weights of the best validation retrieval are kept.

Expected: no number of it has been recorded; `tiny` alone is run, by the tests.
"""
from motion_jax.configs import common


def get_config(size="full"):
  _, size = common.data_and_size(size, (), ("full", "small", "tiny"))
  config = common.experiment("evaluator.snapmogen", seed=0)
  config.frozen = dict(text="google/t5-v1_1-base")
  config.model = dict(features=148, columns=148, width=256, depth=6, num_heads=4, mlp_width=1024, dropout=0.1)
  config.loss = dict(reconstruction=1.0, divergence=1e-5, latent=1e-5, contrast=0.1, temperature=0.1)
  config.data = common.captioned_data(name="snapmogen", layout="snapmogen_148", batch_size=128, min_frames=128,
                                      max_frames=320, lengths=(320,), frames_per_latent=8, shorten_rate=0.0,
                                      max_words=120, keep_long=True, same="caption")
  config.optimizer = common.optimizer(learning_rate=1e-4, warmup_steps=2_000, beta2=0.99, weight_decay=1e-5,
                                      clip_norm=1.0)
  config.train = common.train(num_steps=50_000, log_every=50, save_every=1_000, best="max recall")
  if size == "small":
    config.frozen.text = "words"
    config.model.update(width=64, depth=2, mlp_width=128)
    config.data.update(batch_size=64)
    config.train.update(num_steps=5_000, save_every=500)
  elif size == "tiny":
    config.frozen.text = "random-init"
    config.model.update(width=16, depth=1, num_heads=2, mlp_width=16)
    common.tiny(config, min_frames=40, max_frames=160, lengths=(160,))
  return config.lock()
