"""Names for the axes of parameters, by which a mesh shards a network (docs/pods.md#sharding).

A module states the names of an array once, at its initializer. Rules of a config map names to the axes of a mesh:

  embed   the residual stream            heads   channels of all attention heads
  mlp     hidden layer of a feed-forward film    shifts, scales and gates of a modulation
  layers  the layers of a stack that is scanned

Arrays and axes without a name stay whole on every device, unless a layout shards all large arrays.
"""
import contextlib
import contextvars
from collections.abc import Callable, Iterator
from typing import Any

import flax.linen as nn
import jax

Axes = tuple[str | None, ...]

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
    missing = array.ndim - len(found)
    return ("layers" if found else None,) * missing + tuple(found)

  return jax.tree.map(names, boxed, is_leaf=is_box)
