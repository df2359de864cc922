"""TMR, a whole-body teacher: Gaussians of motions and captions in one space, and a decoder back to motion.

  python launch.py --config configs/tmr.py --workdir runs/tmr --config.data.folder=HumanML3D \
      --config.frozen.text=distilbert-base-uncased
  ... --config configs/tmr.py:small     on the archives, with the text encoder that ships
  ... --config configs/tmr.py:mini      the same in minutes
  ... --config configs/tmr.py:tiny      two steps on formulas, seconds

`full` is the published configuration (docs/papers/cmdm.md#tmr): 16.1 M parameters beside the frozen DistilBERT, 500
epochs, the last weights. model.pool "token" compares the motion's Gaussian with the caption's, as published; "real"
compares the mean of the rows of its frames instead, which is what a teacher of frames needs:
configs/ablations/cmdm.py:teacher-tmr. loss.threshold: captions with a cosine over 2 * threshold - 1 are no
counter-examples, by the sentence vectors of frozen.sentence.

Other data: kit, and kit_small, kit_tiny.
"""
import ml_collections


def get_config(size="full"):
  dataset, _, own_size = size.partition("_")
  if dataset == "kit":
    size = own_size or "full"
  config = ml_collections.ConfigDict()
  config.stage = "cmdm.teacher"
  config.seed = 1234
  # text: whose words are read; it stays as it is. sentence: whose sentence vectors say which captions are alike.
  config.frozen = dict(text="distilbert-base-uncased", sentence="sentence-transformers/all-mpnet-base-v2")
  config.text = dict()  # the run fills in how wide a word is
  config.model = dict(kind="tmr", width=256, depth=6, num_heads=4, mlp_width=1024, dropout=0.1, pool="token")
  config.loss = dict(recons=1.0, kl=1e-5, latent=1e-5, contrastive=0.1, temperature=0.1, threshold=0.8)
  # per_column: each number has its own std, not its block's; captions are not cut, whatever their length.
  config.data = dict(name="humanml3d", folder="", folders=(), layout="full", mode="benchmark", mirror=False,
                     batch_size=32, max_frames=200, per_column=True)
  config.optimizer = dict(learning_rate=1e-4, schedule="constant", boundaries=(), gamma=0.1, cooldown_steps=0,
                          warmup_steps=0, beta1=0.9, beta2=0.999, weight_decay=0.01, clip_norm=0.0, ema_decay=0.0,
                          skip_loss=0.0)
  config.train = dict(num_steps=380_000, log_every=50, save_every=7_600)
  if dataset == "kit":
    config.data.update(layout="full_kit", max_frames=125)
    config.train.update(num_steps=75_000, save_every=1_500)
  if size in ("small", "mini"):
    config.frozen.update(text="words", sentence="words")
    config.model.update(width=64, depth=2, mlp_width=128, dropout=0.0)
    config.data.update(name="archive", mode="corrected", mirror=True, batch_size=64, max_frames=96, per_column=False)
    config.optimizer.update(learning_rate=1e-3, warmup_steps=100, schedule="cosine", ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=1_500, save_every=250)
    if size == "mini":
      config.model.update(depth=1)
      config.data.batch_size = 32
      config.optimizer.update(warmup_steps=20, ema_decay=0.98)
      config.train.update(num_steps=400, log_every=20, save_every=200)
  elif size == "tiny":
    config.frozen.update(text="fresh", sentence="fresh")
    config.model.update(width=8, depth=1, num_heads=2, mlp_width=8)
    config.data.update(name="synthetic", mode="corrected", batch_size=4, max_frames=64)
    config.train.update(num_steps=2, log_every=1, save_every=2)
  elif size != "full":
    raise ValueError(f"got size {size!r}, expected full, small, mini or tiny, or kit before it")
  return config.lock()
