"""clip-evaluator-small, the CLIP-type evaluator that ships: one pass of evaluator_clip:small.

  motion-jax train --config shipped/clip_evaluator_small --workdir runs/clip-evaluator-small
  python tools/export_model.py runs/clip-evaluator-small/clip runs/clip-evaluator-small-exported

27 minutes of a quarter of one shared core (motion_jax/pretrained/clip-evaluator-small/README.md).
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  return recipe.get_config([recipe.train("clip", "evaluator_clip:small", ("cmu", "bandai"))], size)
