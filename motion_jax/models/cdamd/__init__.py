"""CDAMD on a page: "Coordinate-based Dual-constrained Autoregressive Motion Generation".

An autoencoder turns joint coordinates into latents, four frames each; a residual VQ-VAE turns them into codes, the
prior that constrains attention in training. A masked transformer reads the latents that are known, and a small
diffusion network makes the masked ones, some more in every decoding iteration. What is known may be an existing motion:
so parts of it are edited.

  features (B, T, F) -> encode -> latents (B, T / 4, C) -> generate, edit -> decode -> features

losses     of the generator
stages     what is trained, as pure functions
setup      a config becomes a stage with its data
unmasking  the loop over decoding iterations; `draws` its random numbers
sampling   generating; `editing` regenerates parts of a motion
model      ready to use
weights    the authors' PyTorch files

Shared with MoMask, in the folder above: `autoencoders` (autoencoder and RVQ-VAE), `mask_schedule` (which latents are
masked, in training and in each decoding iteration), `length` (how long a motion should be).

Numbers follow the released code (docs/papers/cdamd.md); where the paper differs a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.cdamd.editing import (
    edit,
  )
  from motion_jax.models.cdamd.losses import (
    generator_loss,
    trained_mask,
  )
  from motion_jax.models.cdamd.sampling import (
    Plan,
    generate,
    make_latents,
    make_plan,
    start_decoding,
  )
  from motion_jax.models.cdamd.stages import (
    frozen_shapes,
    generator_shapes,
    generator_stage,
    make_generator,
    prior_codes,
  )
  from motion_jax.models.shared.autoencoders import (
    DISTANCES,
    autoencoder_shapes,
    autoencoder_stage,
    autoencoder_terms,
    empty_codebooks,
    l1,
    rvq_stage,
    rvq_terms,
    smooth_l1,
  )

__all__ = ["DISTANCES", "Plan", "autoencoder_shapes", "autoencoder_stage", "autoencoder_terms", "edit",
           "empty_codebooks", "frozen_shapes", "generate", "generator_loss", "generator_shapes", "generator_stage",
           "l1", "make_generator", "make_latents", "make_plan", "prior_codes", "rvq_stage", "rvq_terms", "smooth_l1",
           "start_decoding", "trained_mask"]

__getattr__, __dir__ = lazy.attach(__name__)
