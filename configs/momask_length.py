"""MoMask's length estimator, for prompts that come without a length: MARDM's, on MoMask's features.

  motion-jax train --config momask_length --workdir runs/length --data HumanML3D --config.frozen.text=CLIP-FOLDER
  ... --config momask_length:kit     KIT's 21 joints; as in kit_tiny with a size behind
  ... --config momask_length:laptop  on archives; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released model's size (docs/papers/momask.md#where-it-is-here):
435,122 parameters, trained as MARDM's (docs/papers/cdamd.md#length). A generator takes it by
--config.frozen.length=runs/length.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax.configs import cdamd_length


def get_config(size="full"):
  config = cdamd_length.get_config(size).unlock()
  config.stage = "momask.length"
  config.data.layout = "full_kit" if size.startswith("kit") else "full"
  return config.lock()
