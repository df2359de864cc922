"""cmdm-open, the text-to-motion model that may be used commercially: tokenizer, decoder, denoiser, one pass each, from
scratch on free archives.

  motion-jax train --config shipped/cmdm_open --workdir runs/cmdm-open --config.archives=FOLDER_OF_THE_ARCHIVES
  python tools/export_model.py runs/cmdm-open/den runs/cmdm-open-exported

No teacher: the one that ships has learned from bandai, which is NonCommercial. Times and measurements:
docs/lab/cmdm-open.md, motion_jax/pretrained/cmdm-open/README.md.

It has not been run from nothing: the weights that ship came from the recipe of commit 39e51fd and shorter passes `dec`
and `den` of this one (motion_jax/pretrained/cmdm-open/README.md).
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  data = recipe.OPEN
  return recipe.get_config([*recipe.cmdm_tokenizer(data, shares=(4, 4)), recipe.cmdm_denoiser(data, share=8)], size)
