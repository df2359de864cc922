from .goals import conditions, goal_error, goal_mask
from .losses import contact_error, masked_l2, mdm_terms
from .sampling import Condition, Plan, denoise, next_block, predictor
from .stages import denoiser_shapes, denoiser_stage

__all__ = ["Condition", "Plan", "conditions", "contact_error", "denoise", "denoiser_shapes", "denoiser_stage",
           "goal_error", "goal_mask", "masked_l2", "mdm_terms", "next_block", "predictor"]
