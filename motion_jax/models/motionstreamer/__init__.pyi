from .losses import autoencoder_terms, num_replaced, two_forward_loss
from .sampling import Plan, Segment, begin, draw_latent, follow, sample_segment
from .stages import (
  generator_shapes,
  generator_stage,
  tokenizer_shapes,
  tokenizer_stage,
)

__all__ = ["Plan", "Segment", "autoencoder_terms", "begin", "draw_latent", "follow", "generator_shapes",
           "generator_stage", "num_replaced", "sample_segment", "tokenizer_shapes", "tokenizer_stage",
           "two_forward_loss"]
