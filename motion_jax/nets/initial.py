"""PyTorch's initialization, for networks whose reference implementation relies on it."""
import re
import zlib
from typing import Any

import flax
import jax
import jax.numpy as jnp

_STACKED = ("query", "key", "value", "q", "k", "v")  # PyTorch's attention has one matrix for these three


def initial_as_pytorch(params: Any, rng: jax.Array, alike: str = "", xavier: bool = False) -> Any:
  """Draws the parameters of transformers from PyTorch's default distributions.

  Kernels and biases of linear layers are uniform within 1 / sqrt(inputs), the three kernels of attention Xavier uniform
  as one matrix, their biases and that of attention's output 0; norms and other arrays are not changed. alike: a name
  prefix; layers with it get the parameters of the first one, as PyTorch's TransformerEncoder copies its layer. xavier:
  all kernels of layers in a stack are Xavier uniform.
  """
  flat = flax.traverse_util.flatten_dict(params)

  def draw(path, leaf):
    name, part = path[-1], path[-2] if len(path) > 1 else ""
    kernel = flat.get((*path[:-1], "kernel"))
    if name not in ("kernel", "bias") or kernel is None or kernel.ndim != 2:
      return leaf
    fan_in, fan_out = kernel.shape
    if name == "bias" and (part in _STACKED or part in ("o", "out") and any(
        (*path[:-2], sibling, "kernel") in flat for sibling in _STACKED)):
      return jnp.zeros_like(leaf)
    key = jax.random.fold_in(rng, zlib.crc32("/".join(path).encode()))
    bound = fan_in ** -0.5
    if name == "kernel" and (part in _STACKED or xavier and len(path) > 3):
      bound = (6 / (fan_in + (3 if part in _STACKED else 1) * fan_out)) ** 0.5
    return jax.random.uniform(key, leaf.shape, leaf.dtype, -bound, bound)

  drawn = {path: draw(path, leaf) for path, leaf in flat.items()}
  if alike:
    first = lambda path: tuple(f"{alike}0" if re.fullmatch(rf"{alike}\d+", part) else part for part in path)
    drawn = {path: drawn.get(first(path), leaf) if drawn.get(first(path), leaf).shape == leaf.shape else leaf
            for path, leaf in drawn.items()}
  return flax.traverse_util.unflatten_dict(drawn)
