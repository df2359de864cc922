"""Names for the axes of parameters, by which a mesh shards a network (docs/pods.md#sharding).

A module states the names of an array once, at its initializer. Rules of a config map names to the axes of a mesh:

  embed   the residual stream            heads   channels of all attention heads
  mlp     hidden layer of a feed-forward film    shifts, scales and gates of a modulation
  layers  the layers of a stack that is scanned

Arrays and axes without a name stay whole on every device, but for the rule ANY.
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
ANY = "*"                      # in a rule: the longest axis of a large array that has no other axis on this one
LEAST_SHARDED = 1024           # numbers of an array that is sharded over data
_TENSOR = (("heads", MODEL), ("mlp", MODEL), ("film", MODEL))
LAYOUTS: dict[str, Rules] = {
    "replicated": (),
    "tensor": _TENSOR,
    "fully_sharded": (*_TENSOR, ("embed", DATA), (ANY, DATA)),
}

_boxed = contextvars.ContextVar("boxed", default=False)


def partitioned(init: Callable[..., jax.Array], axes: Axes) -> Callable[..., Any]:
  """An initializer whose array has names for its axes in `axes_of`, and is a plain array everywhere else."""
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
  """The tree that init(*args) returns with, in place of each array, the names of its axes: one name or None for each.

  Nothing is computed. An array that was stacked after its initialization has the axis "layers" in front.
  """
  with _boxing():
    boxed = jax.eval_shape(lambda *args: init(*args), *args)  # a new function: the traces of others are not boxed
  is_box = lambda node: isinstance(node, nn.LogicallyPartitioned)

  def names(leaf: Any) -> Axes:
    found, array = (leaf.names, leaf.value) if is_box(leaf) else ((), leaf)
    if not hasattr(array, "ndim"):
      return array  # an optimizer's mark that it leaves this parameter to another one
    missing = array.ndim - len(found)
    return ("layers" if found else None,) * missing + tuple(found)

  return jax.tree.map(names, boxed, is_leaf=is_box)


def is_axes(node: Any) -> bool:
  """Whether a node of the tree of `axes_of` is a leaf."""
  return type(node) is tuple and all(name is None or isinstance(name, str) for name in node)


def shardings(axes: Any, shapes: Any, mesh: Mesh | AbstractMesh, rules: Rules) -> Any:
  """The NamedSharding of each array of a tree of arrays or shapes, whose axes are named by `axes` (of `axes_of`).

  Raises InputError for an axis that a rule places on "model", and that the mesh does not divide. On "data", such an
  axis stays whole, and so do vectors and small arrays.
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
