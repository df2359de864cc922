"""MDM on a page: "Human Motion Diffusion Model", and DiP, its autoregressive form.

A transformer predicts the clean motion of all frames at once from a noisy one, a diffusion step and a caption; the step
back draws the less noisy motion that both allow. DiP reads the clean frames before those that it generates, and goes
on from its own.

  noise (B, T, F) -> clean features, step by step -> motion

losses    the error of the features, and geometric terms on joints
goals     DiP's targets: where a motion ends
sampling  steps, guidance, painting over what is known, blocks in sequence
editing   which part of a motion an edit keeps

Numbers follow the released code (docs/papers/mdm.md); where it is wrong a comment starts with "Parity".
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.mdm.goals import conditions, goal_error, goal_mask
  from motion_jax.models.mdm.losses import contact_error, masked_l2, mdm_terms
  from motion_jax.models.mdm.sampling import Condition, Plan, denoise, next_block, predictor
  from motion_jax.models.mdm.stages import denoiser_shapes, denoiser_stage

__all__ = ["Condition", "Plan", "conditions", "contact_error", "denoise", "denoiser_shapes", "denoiser_stage",
           "goal_error", "goal_mask", "masked_l2", "mdm_terms", "next_block", "predictor"]

__getattr__, __dir__ = lazy.attach(__name__)
