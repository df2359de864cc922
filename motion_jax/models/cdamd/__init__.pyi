from .losses import (
  generator_loss,
  trained_mask,
)
from .sampling import (
  Plan,
  generate,
  make_latents,
  make_plan,
  start_decoding,
)
from .stages import (
  DISTANCES,
  autoencoder_shapes,
  autoencoder_stage,
  autoencoder_terms,
  empty_codebooks,
  frozen_shapes,
  generator_shapes,
  generator_stage,
  l1,
  make_generator,
  prior_codes,
  rvq_stage,
  rvq_terms,
  smooth_l1,
)

__all__ = ["DISTANCES", "Plan", "autoencoder_shapes", "autoencoder_stage", "autoencoder_terms",
           "empty_codebooks", "frozen_shapes", "generate", "generator_loss", "generator_shapes", "generator_stage",
           "l1", "make_generator", "make_latents", "make_plan", "prior_codes", "rvq_stage", "rvq_terms", "smooth_l1",
           "start_decoding", "trained_mask"]
