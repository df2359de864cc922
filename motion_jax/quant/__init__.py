"""Vector quantizers: latents to codes and back."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.quant import rvq, vq
  from motion_jax.quant.rvq import Quantized
  from motion_jax.quant.vq import Codebook, codebook_of, empty_codebook

__all__ = ["Codebook", "Quantized", "codebook_of", "empty_codebook", "rvq", "vq"]

__getattr__, __dir__ = lazy.attach(__name__)
