from . import control, data, diffusion, draw, export, metrics, models, motion, nets, quant, rigs, text
from .data.clip import Caption, Clip
from .loading import load
from .models import cdamd, cmdm
from .models.base import Model
from .models.results import Motion

__version__: str

__all__ = ["Caption", "Clip", "Model", "Motion", "cdamd", "cmdm", "control", "data", "diffusion", "draw", "export",
           "load", "metrics", "models", "motion", "nets", "quant", "rigs", "text"]
