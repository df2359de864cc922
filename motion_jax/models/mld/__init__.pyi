from .losses import kl_terms, prediction_error, vae_terms
from .sampling import FrameDenoiser, Plan, ddim_steps, denoise, predictor
from .stages import denoiser_shapes, denoiser_stage, frames_stage, vae_shapes, vae_stage

__all__ = ["FrameDenoiser", "Plan", "ddim_steps", "denoise", "denoiser_shapes", "denoiser_stage", "frames_stage",
           "kl_terms", "prediction_error", "predictor", "vae_shapes", "vae_stage", "vae_terms"]
