"""evaluator-small, the matching evaluator that ships: the movement autoencoder, then encoders that are matched on it.

  motion-jax train --config shipped/evaluator_small --workdir runs/evaluator-small
  python tools/export_model.py runs/evaluator-small/evaluator runs/evaluator-small-exported

About 30 minutes of a third of one shared core (motion_jax/pretrained/evaluator-small/README.md).
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  archives = ("cmu", "bandai")
  return recipe.get_config([
      recipe.train("movement", "evaluator_movement:small", archives),
      recipe.train("evaluator", "evaluator_matching:small", archives, frozen={"movement": "{movement}"}),
  ], size)
