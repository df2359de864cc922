"""MotionStreamer on a page: a causal autoencoder, and one latent after the other by a transformer and a diffusion head.

The autoencoder looks back only, so each new latent gives four more frames at once. The transformer reads a caption and
the latents so far; a small network denoises the next latent given its row. In training part of the latents that it
reads are its own.

  caption, latents so far -> condition (B, D) -> noise to latent (B, C), 50 steps -> decode -> 4 frames

losses    of the autoencoder; of the generator, with two forward passes
sampling  segments: caption and latents so far in a cache, latents one by one, their end

Numbers follow the released code (docs/papers/motionstreamer.md); where it is wrong a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.motionstreamer.losses import autoencoder_terms, num_replaced, two_forward_loss
  from motion_jax.models.motionstreamer.sampling import Plan, Segment, begin, draw_latent, follow, sample_segment
  from motion_jax.models.motionstreamer.stages import (
    generator_shapes,
    generator_stage,
    tokenizer_shapes,
    tokenizer_stage,
  )

__all__ = ["Plan", "Segment", "autoencoder_terms", "begin", "draw_latent", "follow", "generator_shapes",
           "generator_stage", "num_replaced", "sample_segment", "tokenizer_shapes", "tokenizer_stage",
           "two_forward_loss"]

__getattr__, __dir__ = lazy.attach(__name__)
