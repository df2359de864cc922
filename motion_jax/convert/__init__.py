"""PyTorch files become parameters and run folders: `motion-jax convert`.

`state` reads a checkpoint without unpickling it and turns its tensors by a table of names; `parts` is what every
conversion shares. The tables and the sizes of each method stand beside it: `models/cmdm/weights.py`,
`models/cdamd/weights.py`, `evaluators/weights.py`.
"""
from motion_jax.convert.state import from_torch, load_checkpoint, load_state, post_norm_names, select

__all__ = ["from_torch", "load_checkpoint", "load_state", "post_norm_names", "select"]
