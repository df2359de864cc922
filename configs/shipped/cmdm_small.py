"""cmdm-small, the text-to-motion model that ships: tokenizer with its teacher, decoder, denoiser, adapters for
constraints, one pass each.

  motion-jax train --config shipped/cmdm_small --workdir runs/cmdm-small --config.archives=FOLDER_OF_THE_ARCHIVES
  python tools/export_model.py runs/cmdm-small/adapters runs/cmdm-small-exported

The teacher is `part-tmr-small` (shipped/part_tmr_small.py), the text encoder that of the model that ships
(docs/lab/words.md). Times and measurements: docs/lab/cmdm-small.md, motion_jax/pretrained/cmdm-small/README.md.

It has not been run from nothing: the weights that ship came from the recipe of commit 39e51fd and shorter passes `dec`,
`den` and `adapters` of this one (motion_jax/pretrained/cmdm-small/README.md).
"""
from motion_jax.configs.shipped import recipe

DEPTH = {"small": 6, "tiny": 1}


def get_config(size="small"):
  data = recipe.NON_COMMERCIAL
  # All but the adapters is frozen, so that motions without constraints stay the same.
  frozen = ("x_in", "text_in", "time_in", "time_out", "out", *(f"block{i}" for i in range(DEPTH.get(size, 6))))
  return recipe.get_config([
      *recipe.cmdm_tokenizer(data, shares=(5, 5), teacher="part-tmr-small"),
      recipe.cmdm_denoiser(data, share=10),
      recipe.train("adapters", "cmdm_denoiser:small", data, 3, frozen={"tokenizer": "{den}", "text": "cmdm-small"},
                   train=recipe.steps(6_000, start="{den}", freeze=frozen),
                   data=recipe.CAPTIONED | {"control": 1.0, "batch_size": 64, "lengths": (192,)},
                   loss={"control": 10.0, "decoded_from": 0.0, "pyramid_levels": 1.0, "drop_rate": 0.5},
                   optimizer=recipe.rates(1e-3, 1_000, ema_decay=0.99, warmup=50),
                   sampler=recipe.SAMPLER, cleanup=recipe.UNSMOOTHED),
  ], size)
