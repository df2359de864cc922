"""MoMask on a page: "Generative Masked Modeling of 3D Human Motions".

A residual VQ-VAE turns four frames each into six codes, of which each names what those before left over. A masked
transformer fills the codes of level 0: all of them hidden at first, in each round the most certain ones are kept. A
residual transformer adds the other levels, one pass each. Known codes may be an existing motion's: so it is edited.

  features (B, T, F) -> codes (B, T / 4, Q); caption -> level 0 in rounds -> levels 1 .. Q - 1 -> decode -> features

losses    of the two transformers; those of the RVQ-VAE: `shared.autoencoders`
stages    what is trained, as pure functions
setup     a config becomes a stage with its data
sampling  masked decoding, residual levels
model     ready to use
weights   the authors' PyTorch files

Numbers follow the released code (docs/papers/momask.md); where the paper differs a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.momask.losses import hide, level_of, masked_loss, residual_loss
  from motion_jax.models.momask.sampling import add_levels, chooser, decode_masked, keep_likeliest, noise_of
  from motion_jax.models.momask.stages import masked_shapes, masked_stage, residual_shapes, residual_stage

__all__ = ["add_levels", "chooser", "decode_masked", "hide", "keep_likeliest", "level_of", "masked_loss",
           "masked_shapes", "masked_stage", "noise_of", "residual_loss", "residual_shapes", "residual_stage"]

__getattr__, __dir__ = lazy.attach(__name__)
