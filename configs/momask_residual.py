"""MoMask's residual transformer: codes of the levels above level 0, on codes of a trained RVQ-VAE.

  motion-jax train --config momask_residual --workdir runs/momask_residual --data HumanML3D \
      --config.frozen.text=CLIP-FOLDER --config.frozen.tokenizer=runs/momask_rvq
  ... --config momask_residual:kit      KIT's 21 joints; as in kit_tiny with a size behind
  ... --config momask_residual:laptop   on archives, minutes on a laptop; tiny: two steps on procedural motion

How sizes are written: docs/configs.md. `full` is the released command with --share_weight
(docs/papers/momask.md#training): 13.4 M parameters, 500 epochs. The masked transformer takes it by
--config.frozen.residual.

Expected: `full` and `laptop` have not been run to their end.
"""
from motion_jax.configs.momask_masked import transformer


def get_config(size="full"):
  return transformer("momask.residual", size)
