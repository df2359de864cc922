"""cmdm-small-fast, the student of cmdm-small that samples in 8 steps: one pass, from the shipped teacher.

  motion-jax train --config shipped/cmdm_small_fast --workdir runs/cmdm-small-fast \
      --config.archives=FOLDER_OF_THE_ARCHIVES
  python tools/export_model.py runs/cmdm-small-fast/fast runs/cmdm-small-fast-exported --shares cmdm-small

Times and measurements: motion_jax/pretrained/cmdm-small-fast/README.md.

It has made no shipped model yet: the weights that ship came from the recipe of commit 39e51fd
(motion_jax/pretrained/cmdm-small-fast/README.md).
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  return recipe.get_config([recipe.train(
      "fast", "cmdm_student:8_small", recipe.NON_COMMERCIAL, 1, distill={"teacher": "cmdm-small"},
      data=recipe.CAPTIONED | {"per_segment_captions": 0.5, "batch_size": 64, "lengths": (192,)},
      train=recipe.steps(6_000), optimizer=recipe.rates(3e-4, 800, ema_decay=0.995, warmup=50),
      sampler={"side_guidance": 1.0}, cleanup=recipe.UNSMOOTHED)], size)
