"""Text-to-motion generation in JAX.

  import motion_jax as mj
  model = mj.load("cmdm-small")
  motion = model.generate("a person waves", num_frames=120, seeds=[0])[0]
  motion.save("wave.mp4")
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax import control, data, diffusion, draw, export, metrics, models, motion, nets, quant, rigs, text
  from motion_jax.data.clip import Caption, Clip
  from motion_jax.loading import load
  from motion_jax.models import cdamd, cmdm
  from motion_jax.models.base import Model
  from motion_jax.models.results import Motion

__version__ = "0.2.0"

__all__ = ["Caption", "Clip", "Model", "Motion", "cdamd", "cmdm", "control", "data", "diffusion", "draw", "export",
           "load", "metrics", "models", "motion", "nets", "quant", "rigs", "text"]

__getattr__, __dir__ = lazy.attach(__name__)
