from . import rvq, vq
from .rvq import Quantized
from .vq import Codebook, codebook_of, empty_codebook

__all__ = ["Codebook", "Quantized", "codebook_of", "empty_codebook", "rvq", "vq"]
