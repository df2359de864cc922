"""MotionPatches, an image-transformer teacher: joints as an image, a vision transformer, captions by contrast.

  motion-jax train --config motion_patches --workdir runs/motion_patches --data HumanML3D \
      --config.frozen.text=distilbert-base-uncased --config.frozen.vit=path/to/vit_base_patch16_224.augreg_in21k
  ... --config motion_patches:small     on archives, with the text encoder that ships; also mini, tiny, and kit, ...

How sizes are written: docs/configs.md. `full` is the published configuration (docs/papers/cmdm.md#motionpatches):
152.6 M parameters with DistilBERT. frozen.vit is a folder with the model.safetensors of an ImageNet ViT-B/16, under
timm's names or Hugging Face's; left empty, the ViT starts from random weights. The run's config.json says which, under
"origin". The weights of the best validation recall are kept.

Expected: no number of it has been recorded; `tiny` alone is run, by the tests.
"""
from motion_jax.configs import common


def get_config(size="full"):
  dataset, size = common.data_and_size(size, ("kit",), ("full", "small", "mini", "tiny"))
  config = common.experiment("tmr.teacher", seed=42)
  # text, vit: where both transformers start from; they are trained. sentence: as in configs/tmr.py.
  config.frozen = dict(text="distilbert-base-uncased", sentence="", vit="")
  config.origin = dict()  # where the weights came from that it started with; the run fills it in
  config.text = dict()  # fields of the text transformer; the run fills them in from frozen.text
  config.model = dict(kind="motion_patches", width=768, depth=12, num_heads=12, mlp_width=3072, dim=256,
                      head_dropout=0.5, num_rows=224, upsample=False)
  config.loss = dict(text_pool="first", skip_same_caption=False)
  # per_column: each joint and axis has its own mean and std. Parity: of training, the original's are of all splits.
  config.data = common.data(layout="coordinates", batch_size=128, max_frames=224, max_words=128, per_column=True)
  # rates: times the learning rate, for all parameters below a name.
  config.optimizer = common.optimizer(learning_rate=1e-4, schedule="half_cosine",
                                      rates=dict(text=0.1, logit_scale=0.0))
  # Parity: the original keeps the epoch that is best on the test split; ours is chosen by validation.
  config.train = common.epochs(50, log_every=50, num_saves=50, best="max back_r1")
  if dataset == "kit":
    config.model.update(head_dropout=0.0, upsample=True)
    config.data.update(layout="coordinates_kit", max_frames=134)
    config.optimizer.learning_rate = 1e-5
    config.optimizer.rates.text = 1.0
  if size in ("small", "mini"):
    config.frozen.text = "words"
    config.model.update(width=96, depth=3, num_heads=4, mlp_width=192, dim=64, head_dropout=0.2, num_rows=96)
    common.same_words_are_no_counter_examples(config)
    common.small_teacher(config, max_words=24)
    config.optimizer.rates.text = 0.1
    config.train.update(num_steps=1_000, save_every=250)
    if dataset == "kit":
      config.data.max_frames = 58  # what 96 rows show
    if size == "mini":
      config.model.update(depth=2, width=64, mlp_width=128)
      common.mini_teacher(config)
  elif size == "tiny":
    config.frozen.text = "random-init"
    config.model.update(width=16, depth=1, num_heads=2, mlp_width=16, dim=8, num_rows=64)
    common.tiny(config, max_frames=64, max_words=24)
    if dataset == "kit":
      config.data.max_frames = 38  # what 64 rows show
    config.train.best = ""
  return config.lock()
