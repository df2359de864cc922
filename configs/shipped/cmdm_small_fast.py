"""cmdm-small-fast, the student of cmdm-small that samples in 8 steps: one pass, from the shipped teacher.

  motion-jax train --config shipped/cmdm_small_fast --workdir runs/cmdm-small-fast \
      --config.archives=FOLDER_OF_THE_ARCHIVES
  python tools/export_model.py runs/cmdm-small-fast/fast runs/cmdm-small-fast-exported --shares cmdm-small

Times, measurements and where the weights that ship began, which were not the teacher's:
motion_jax/pretrained/cmdm-small-fast/README.md.
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  return recipe.get_config([recipe.train(
      "fast", "cmdm_student:8_small", recipe.NON_COMMERCIAL, 1, distill={"teacher": "cmdm-small"},
      data=recipe.CAPTIONED | {"per_segment_captions": 0.5, "batch_size": 32, "lengths": (192,)},
      train=recipe.steps(850), optimizer=recipe.rates(2e-4, 300, ema_decay=0.995, warmup=50),
      sampler={"side_guidance": 1.0, "clauses": True}, cleanup=recipe.UNSMOOTHED)], size)
