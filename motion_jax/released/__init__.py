"""The authors' PyTorch weights become run folders: `motion-jax convert` (names in facts: cmdm 9, cdamd 2 to 8).

Sizes are read off the tensors. What tensors do not tell (heads, block, statistics, text encoder) is a flag or the
released code's value. A folder appears whole or not at all.
"""
from motion_jax.released.cdamd import autoencoder, generator, length_estimator, rvq, write_cdamd
from motion_jax.released.cmdm import denoiser, tokenizer, write_cmdm
from motion_jax.released.evaluators import evaluator, write_evaluator
from motion_jax.released.parts import Network, Part, read_part
from motion_jax.released.teachers import teacher, write_teacher

__all__ = ["Network", "Part", "autoencoder", "denoiser", "evaluator", "generator", "length_estimator",
           "read_part", "rvq", "teacher", "tokenizer", "write_cdamd", "write_cmdm", "write_evaluator", "write_teacher"]
