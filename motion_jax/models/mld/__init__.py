"""MLD on a page: "Executing your Commands via Motion Diffusion in Latent Space".

A transformer VAE turns a motion of any length into one token; a small transformer, its layers joined by skips, denoises
that token given a caption.

  noise (B, 1, D) -> token, in 50 steps of DDIM -> decode with the wanted length -> features (B, T, F)

losses    of the VAE and of the denoiser
sampling  steps and guidance

Numbers follow the released code (docs/papers/mld.md); where it is wrong a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.mld.losses import kl_terms, prediction_error, vae_terms
  from motion_jax.models.mld.sampling import FrameDenoiser, Plan, ddim_steps, denoise, predictor
  from motion_jax.models.mld.stages import denoiser_shapes, denoiser_stage, frames_stage, vae_shapes, vae_stage

__all__ = ["FrameDenoiser", "Plan", "ddim_steps", "denoise", "denoiser_shapes", "denoiser_stage", "frames_stage",
           "kl_terms", "prediction_error", "predictor", "vae_shapes", "vae_stage", "vae_terms"]

__getattr__, __dir__ = lazy.attach(__name__)
