"""Released PyTorch weights to parameters, by tables of names: every tensor is accounted for.

A table maps a reference's name, less ".weight" or ".bias", to (our path, kind); the kind says how arrays are turned.
"""
from motion_jax.convert.cdamd import (
  autoencoder_names,
  diffusion_mlp_names,
  mardm_names,
  masked_transformer_names,
  rvq_from_torch,
  rvq_names,
)
from motion_jax.convert.cmdm import (
  TMR_PARTS,
  causal_dit_names,
  causal_vae_names,
  part_tmr_from_torch,
  part_tmr_names,
)
from motion_jax.convert.evaluators import (
  CLIP_EVALUATOR_IGNORED,
  clip_evaluator_names,
  length_estimator_names,
  movement_decoder_names,
  t2m_evaluator_names,
)
from motion_jax.convert.state import (
  from_torch,
  load_checkpoint,
  load_state,
  post_norm_names,
  select,
)
from motion_jax.convert.teachers import (
  motion_patches_from_torch,
  motion_patches_names,
  tmr_names,
  vit_from_torch,
  vit_names,
)

__all__ = ["CLIP_EVALUATOR_IGNORED", "TMR_PARTS", "autoencoder_names", "causal_dit_names", "causal_vae_names",
           "clip_evaluator_names", "diffusion_mlp_names", "from_torch", "length_estimator_names",
           "load_checkpoint", "load_state", "mardm_names", "masked_transformer_names",
           "motion_patches_from_torch", "motion_patches_names", "movement_decoder_names", "part_tmr_from_torch",
           "part_tmr_names", "post_norm_names", "rvq_from_torch", "rvq_names", "select", "t2m_evaluator_names",
           "tmr_names", "vit_from_torch", "vit_names"]
