from .losses import (
  DISTANCE_PAIRS,
  LAST_LAYERS,
  RECONSTRUCTIONS,
  align_factor,
  align_loss,
  align_ratio,
  align_terms,
  gaussian_nll,
  kl_to_standard_normal,
  pool_teacher,
  set_distances,
  smooth_l1,
  tokenizer_terms,
)
from .sampling import (
  block_constants,
  block_control,
  block_pull,
  block_words,
  chain_segment,
  chained,
  generate,
  generate_whole,
  plain_velocity,
  words_of_latents,
)
from .stages import (
  denoiser_shapes,
  denoiser_stage,
  frozen_shapes,
  tokenizer_stage,
)

__all__ = ["DISTANCE_PAIRS", "LAST_LAYERS", "RECONSTRUCTIONS", "align_factor", "align_loss", "align_ratio",
           "align_terms", "block_constants", "block_control", "block_pull", "block_words", "chain_segment", "chained",
           "denoiser_shapes", "denoiser_stage", "frozen_shapes", "gaussian_nll", "generate", "generate_whole",
           "kl_to_standard_normal", "plain_velocity", "pool_teacher", "set_distances", "smooth_l1", "tokenizer_stage",
           "tokenizer_terms", "words_of_latents"]
