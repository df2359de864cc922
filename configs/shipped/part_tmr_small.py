"""part-tmr-small, the motion-language teacher that ships: one pass of part_tmr:small.

  motion-jax train --config shipped/part_tmr_small --workdir runs/part-tmr-small
  python tools/export_model.py runs/part-tmr-small/teacher runs/part-tmr-small-exported

About 17 minutes of two shared cores (motion_jax/pretrained/part-tmr-small/README.md). What cannot be recovered: the run
was planned as 2,500 steps and shortened to 850, with its cosine brought down over the last 200; here the cosine is that
of 850 steps.
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  return recipe.get_config([recipe.train("teacher", "part_tmr:small", ("cmu", "bandai"), train={"num_steps": 850})],
                           size)
