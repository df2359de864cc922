"""Logical names of parameter axes, from which a network's sharding on a mesh follows (docs/pods.md#sharding).

A module names the axes of an array at its initializer. Rules of a config map names to the axes of a mesh:

  embed   the residual stream            heads   channels of all attention heads
  mlp     hidden layer of a feed-forward film    shifts, scales and gates of a modulation
  layers  the layers of a stack that is scanned

Arrays and axes without a name are replicated on every device, except for the rule ANY.
"""
import contextlib
import contextvars
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import flax.linen as nn
import jax
from flax.linen import spmd
from jax.sharding import AbstractMesh, Mesh, NamedSharding, PartitionSpec

from motion_jax.utils.errors import InputError

Axes = tuple[str | None, ...]
Rules = Sequence[tuple[str, str]]  # (name of an axis of an array, axis of the mesh), in order of precedence

DATA, MODEL = "data", "model"  # the axes of the mesh
ANY = "*"                      # in a rule: the longest axis of a large array, unless another is on this mesh axis
LEAST_SHARDED = 1024           # size from which an array is sharded over data
_TENSOR = (("heads", MODEL), ("mlp", MODEL), ("film", MODEL))
LAYOUTS: dict[str, Rules] = {
    "replicated": (),
    "tensor": _TENSOR,
    "fully_sharded": (*_TENSOR, ("embed", DATA), (ANY, DATA)),
}

_boxed = contextvars.ContextVar("boxed", default=False)


def partitioned(init: Callable[..., jax.Array], axes: Axes) -> Callable[..., Any]:
  """Wraps an initializer so that `axes_of` sees names of the axes; elsewhere the array is a plain one."""
  named = nn.with_logical_partitioning(init, axes)
  return lambda *args, **fields: (named if _boxed.get() else init)(*args, **fields)


@contextlib.contextmanager
def _boxing() -> Iterator[None]:
  token = _boxed.set(True)
  try:
    yield
  finally:
    _boxed.reset(token)


def axes_of(init: Callable[..., Any], *args: Any) -> Any:
  """The tree of init(*args) with each array replaced by the names of its axes, a name or None for each.

  It only traces init. An array that was stacked after its initialization has a first axis "layers".
  """
  with _boxing():
    boxed = jax.eval_shape(lambda *args: init(*args), *args)  # a new function: no cached trace without boxes
  is_box = lambda node: isinstance(node, nn.LogicallyPartitioned)

  def names(leaf: Any) -> Axes:
    axes, array = (leaf.names, leaf.value) if is_box(leaf) else ((), leaf)
    if not hasattr(array, "ndim"):
      return array  # an optimizer's marker (optax.MaskedNode) for a parameter of another optimizer
    missing = array.ndim - len(axes)
    return ("layers" if axes else None,) * missing + tuple(axes)

  return jax.tree.map(names, boxed, is_leaf=is_box)


def is_axes(node: Any) -> bool:
  """Whether a node of the tree of `axes_of` is a leaf."""
  return type(node) is tuple and all(name is None or isinstance(name, str) for name in node)


def shardings(axes: Any, shapes: Any, mesh: Mesh | AbstractMesh, rules: Rules) -> Any:
  """The NamedSharding of each array of a tree of arrays or shapes, whose axes are named by `axes` (of `axes_of`).

  Raises InputError for an axis that a rule places on "model" and whose length the mesh does not divide. On "data", such
  an axis is not sharded, nor are vectors and small arrays.
  """
  def sharding(path: Any, names: Axes, leaf: Any) -> NamedSharding:
    names = names if len(names) == leaf.ndim else (None,) * leaf.ndim  # of an optimizer that keeps parts of an array
    return NamedSharding(mesh, _spec(names, leaf.shape, mesh.shape, rules, jax.tree_util.keystr(path)))

  return jax.tree_util.tree_map_with_path(sharding, axes, shapes, is_leaf=is_axes)


def _spec(names: Axes, shape: Sequence[int], sizes: Mapping[str, int], rules: Rules, path: str) -> PartitionSpec:
  large = math.prod(shape) >= LEAST_SHARDED and sum(name != "layers" for name in names) > 1
  rules = [(name, axis) for name, axis in rules if sizes[axis] > 1 and (axis == MODEL or large)]
  fitting = []
  for name, axis in rules:
    size = shape[names.index(name)] if name in names else 0
    if axis == MODEL and size > 1 and size % sizes[axis]:  # 1: a place that an optimizer does not use
      raise InputError(f"got mesh.model {sizes[axis]} and an axis {name!r} of {size} in {path}, expected a divisor; "
                       f"try mesh.model {math.gcd(size, sizes[axis])}, or another width")
    if size and size % sizes[axis] == 0:
      fitting.append((name, axis))
  spec = list(spmd.logical_to_mesh_axes(names, fitting) or ())
  for axis in (axis for name, axis in rules if name == ANY and axis not in spec):
    if free := [i for i, size in enumerate(shape) if spec[i] is None and size % sizes[axis] == 0]:
      spec[max(free, key=lambda i: shape[i])] = axis
  return PartitionSpec(*spec)
