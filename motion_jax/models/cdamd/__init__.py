"""CDAMD on a page: "Coordinate-based Dual-constrained Autoregressive Motion Generation".

An autoencoder turns joint coordinates into latents, four frames each; a residual VQ-VAE turns them into codes, the
prior that constrains attention in training. A masked transformer reads the latents that are known, and a small
diffusion network makes the masked ones, some more in every decoding iteration. What is known may be an existing motion:
so parts of it are edited.

  features (B, T, F) -> encode -> latents (B, T / 4, C) -> generate, edit -> decode -> features

losses         of autoencoder, RVQ-VAE and generator
stages         what is trained, as pure functions
setup          a config becomes a stage with its data
mask_schedule  which latents are masked, in training and in each decoding iteration
unmasking      the loop over decoding iterations; `draws` its random numbers
sampling       generating; `editing` makes parts of a motion anew
model          ready to use; `length` estimates how long a motion should be
weights        the authors' PyTorch files

Numbers follow the released code (docs/papers/cdamd.md); where the paper differs a comment starts with "Parity".
"""
from typing import Any

from motion_jax.runtime import lazy

_WHERE = lazy.names({
    "editing": "edit",
    "losses": "DISTANCES autoencoder_terms generator_loss l1 rvq_terms smooth_l1 trained_mask",
    "sampling": "Plan generate make_latents make_plan",
    "stages": "autoencoder_shapes autoencoder_stage empty_codebooks frozen_shapes generator_shapes generator_stage "
              "make_generator prior_codes rvq_stage",
})
__all__ = sorted(_WHERE)


def __getattr__(name: str) -> Any:
  return lazy.find(__name__, _WHERE, name)


def __dir__() -> list[str]:
  return __all__
