from .losses import hide, level_of, masked_loss, residual_loss
from .sampling import add_levels, chooser, decode_masked, keep_likeliest, noise_of
from .stages import masked_shapes, masked_stage, residual_shapes, residual_stage

__all__ = ["add_levels", "chooser", "decode_masked", "hide", "keep_likeliest", "level_of", "masked_loss",
           "masked_shapes", "masked_stage", "noise_of", "residual_loss", "residual_shapes", "residual_stage"]
