"""Convert weights of text encoders under their Hugging Face names to parameters, and check their configs."""
import re

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.utils import cache

# kind -> ((our leaf, PyTorch's), ...); a kernel is PyTorch's weight, transposed.
LEAVES = {
    "embed": (("embedding", "weight"),),
    "norm": (("scale", "weight"), ("bias", "bias")),
    "scale": (("scale", "weight"),),
    "dense": (("kernel", "weight"), ("bias", "bias")),
    "linear": (("kernel", "weight"),),
}


def check_positions(length, most):
  """Raises ValueError for more word pieces than an encoder has positions."""
  if length > most:
    raise ValueError(f"got {length} word pieces, this encoder has {most} positions; use a shorter sentence")


def check_activation(name, known):
  """Raises ValueError for an activation of a config.json that is not among known, {name: function}."""
  if name not in known:
    raise ValueError(f"got activation {name!r}, expected one of {', '.join(known)}")


def params_from_names(state, table, model, ignored="", dtype=np.float32):
  """Parameters of a text encoder `model` from a state dict {PyTorch name: array}.

  table: our path as a tuple -> (PyTorch name without .weight or .bias, kind); ignored: a pattern of names that belong
  to other parts of the file. Raises ValueError that lists what is missing, unknown or misshapen.
  """
  shapes = cache.kept_shapes("text", model, lambda: jax.eval_shape(lambda: model.init(
      jax.random.key(0), jnp.zeros((1, 1), jnp.int32), jnp.ones((1, 1), bool)))["params"])
  leaves = {f"{theirs}.{leaf}": (path, ours)
            for path, (theirs, kind) in table.items() for ours, leaf in LEAVES[kind]}
  unknown = sorted(name for name in state.keys() - leaves.keys() if not (ignored and re.match(ignored, name)))
  missing = sorted(leaves.keys() - state.keys())
  if missing or unknown:
    listed = lambda names: f"{len(names)} ({', '.join(names[:3])}{', ...' * (len(names) > 3)})" if names else "none"
    raise ValueError(f"the weights do not fit config.json: missing {listed(missing)}, unknown {listed(unknown)}; "
                     f"expected those of a {type(model).__name__} with {model.num_layers} layers")
  params = {}
  for name, (path, leaf) in leaves.items():
    node, shape = params, shapes
    for part in path:
      node, shape = node.setdefault(part, {}), shape[part]
    array = np.asarray(state[name], dtype)
    node[leaf] = array.T if leaf == "kernel" else array
    if node[leaf].shape != shape[leaf].shape:
      expected = shape[leaf].shape[::-1] if leaf == "kernel" else shape[leaf].shape
      raise ValueError(f"{name!r} has shape {array.shape}, config.json asks for {expected}")
  return params
