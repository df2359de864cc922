"""TMR, a whole-body teacher: Gaussians of motions and captions in one space, and a decoder back to motion.

  motion-jax train --config tmr --workdir runs/tmr --data HumanML3D --config.frozen.text=distilbert-base-uncased
  ... --config tmr:small     on archives, with the text encoder that ships; also mini, tiny, and kit, kit_small, ...

How sizes are written: docs/configs.md. `full` is the published configuration (docs/papers/cmdm.md#tmr): 16.1 M
parameters beside the frozen DistilBERT, 500 epochs, the last weights. model.pool "token" compares the motion's Gaussian
with the caption's, as published; "real" compares the mean of the rows of its frames instead, which is what a teacher of
frames needs: ablations/cmdm:teacher-tmr/teacher. loss.threshold: captions with a cosine over 2 * threshold - 1 are no
counter-examples, by the sentence vectors of frozen.sentence.

Expected: no number of it has been recorded; `tiny` alone is run, by the tests.
"""
from motion_jax.configs import common


def get_config(size="full"):
  dataset, size = common.data_and_size(size, ("kit",), ("full", "small", "mini", "tiny"))
  config = common.experiment("tmr.teacher", seed=1234)
  # text: whose words are read; it stays as it is. sentence: whose sentence vectors say which captions are alike.
  config.frozen = dict(text="distilbert-base-uncased", sentence="sentence-transformers/all-mpnet-base-v2", vit="")
  config.origin = dict()  # where the weights came from that it started with; the run fills it in
  config.text = dict()  # the run fills in how wide a word is
  config.model = dict(kind="tmr", width=256, depth=6, num_heads=4, mlp_width=1024, dropout=0.1, pool="token")
  config.loss = dict(recons=1.0, kl=1e-5, latent=1e-5, contrastive=0.1, temperature=0.1, threshold=0.8)
  # per_column: each number has its own std, not its block's; captions are not cut, whatever their length.
  config.data = common.data(layout="full", batch_size=32, max_frames=200, per_column=True)
  config.optimizer = common.optimizer(learning_rate=1e-4, weight_decay=0.01)
  config.train = common.epochs(500, log_every=50, num_saves=50)
  if dataset == "kit":
    config.data.update(layout="full_kit", max_frames=125)
  if size in ("small", "mini"):
    config.frozen.update(text="words", sentence="words")
    config.model.update(width=64, depth=2, mlp_width=128, dropout=0.0)
    common.small_teacher(config, per_column=False)
    config.train.update(num_steps=1_500, save_every=250)
    if size == "mini":
      config.model.update(depth=1)
      common.mini_teacher(config)
  elif size == "tiny":
    config.frozen.update(text="random-init", sentence="random-init")
    config.model.update(width=8, depth=1, num_heads=2, mlp_width=8)
    common.tiny(config, max_frames=64)
  return config.lock()
