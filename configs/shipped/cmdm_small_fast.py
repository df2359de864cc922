"""cmdm-small-fast, the student of cmdm-small that samples in 8 steps: one pass, from the shipped teacher.

  motion-jax train --config shipped/cmdm_small_fast --workdir runs/cmdm-small-fast
  python tools/export_model.py runs/cmdm-small-fast/fast runs/cmdm-small-fast-exported --shares cmdm-small

About 75 minutes of one core (motion_jax/pretrained/cmdm-small-fast/README.md). What cannot be recovered: the run was
planned as 900 steps and prolonged to 1,600, so its learning rate fell along another cosine at first.
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  augment = dict(stitched=0.4, bent_paths=0.1, idle=0.15, counted=0.2, excerpts=0.3, seats=0.1)
  return recipe.get_config([recipe.train(
      "fast", "cmdm_student:8_small", ("cmu", "cmu2", "bandai"), distill={"teacher": "cmdm-small"},
      data={"kinematic_captions": True, "per_segment_captions": 0.5} | {f"augment.{k}": n for k, n in augment.items()},
      train={"num_steps": 1_600})], size)
