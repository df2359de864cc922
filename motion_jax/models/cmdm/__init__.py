"""CMDM on a page: "Causal Motion Diffusion Models for Autoregressive Motion Generation".

A causal VAE turns motion into latents, four frames each, which see no later frame; it may be aligned with a
motion-language teacher (`models.tmr`). A causal diffusion transformer learns to denoise latents that each
have a noise level of their own. Frame-wise sampling cleans them one after the other, a few steps apart, so that motion
streams out while it is made.

  features (B, T, F) -> encode -> latents (B, T / 4, C) -> generate -> decode -> features

losses        of the tokenizer
stages        what is trained, as pure functions
setup         a config becomes a stage with its data
streaming     the frame-wise sampler: one step that offline and live sampling share
sampling      generating and going on as pure functions, by that step or by the plain loop that it is tested against
networks      networks with their weights, compiled
loop          the step driven from the host: motion of any length and kind by one program
model         ready to use; `multi_prompt` tells several prompts in a row, `live` never ends
weights       the authors' PyTorch files

Numbers follow the released code (docs/papers/cmdm.md); where the paper differs a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.cmdm.losses import (
    DISTANCE_PAIRS,
    LAST_LAYERS,
    RECONSTRUCTIONS,
    align_factor,
    align_loss,
    align_ratio,
    align_terms,
    pool_teacher,
    set_distances,
    tokenizer_terms,
  )
  from motion_jax.models.cmdm.sampling import (
    block_constants,
    block_control,
    block_pull,
    block_words,
    chain_segment,
    chained,
    extend,
    generate,
    generate_whole,
    plain_velocity,
    words_of_latents,
  )
  from motion_jax.models.cmdm.stages import (
    denoiser_shapes,
    denoiser_stage,
    frozen_shapes,
    tokenizer_stage,
  )
  from motion_jax.models.shared.likelihoods import gaussian_nll, kl_to_standard_normal, smooth_l1

__all__ = ["DISTANCE_PAIRS", "LAST_LAYERS", "RECONSTRUCTIONS", "align_factor", "align_loss", "align_ratio",
           "align_terms", "block_constants", "block_control", "block_pull", "block_words", "chain_segment", "chained",
           "denoiser_shapes", "denoiser_stage", "extend", "frozen_shapes", "gaussian_nll", "generate", "generate_whole",
           "kl_to_standard_normal", "plain_velocity", "pool_teacher", "set_distances", "smooth_l1", "tokenizer_stage",
           "tokenizer_terms", "words_of_latents"]

__getattr__, __dir__ = lazy.attach(__name__)
