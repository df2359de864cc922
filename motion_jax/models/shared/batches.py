"""Batches of few sizes, each compiled once, so that any number of motions compiles nothing new.

A motion's numbers do not depend on its neighbours, so a batch is filled up with copies of its last motion.
"""
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.models.keys import select_keys

SIZES = (1, 4, 32)  # with more than 4 rows CMDM's steps are no faster on two cores (docs/lab/speed.md#batches)


def batch_sizes(count: int, sizes: Sequence[int] = SIZES) -> list[int]:
  """Sizes of the batches of count motions, each the largest that they fill by more than half: a batch that is half
  empty takes as long as its motions one after the other.

  1: 1    2: 1 1    3: 4    6: 4 1 1    40: 32 4 4
  """
  left, chosen = count, []
  while left > 0:
    chosen.append(max(size for size in sizes if size < 2 * left))
    left -= chosen[-1]
  return chosen


def batches(count: int, sizes: Sequence[int] = SIZES) -> Iterator[np.ndarray]:
  """Indices of count motions in batches of these sizes, the last index repeated where it fills one up."""
  first = 0
  for size in batch_sizes(count, sizes):
    yield np.minimum(np.arange(first, first + size), count - 1)
    first += size


def joined(parts: Sequence[Any], count: int) -> np.ndarray:
  """Arrays of the batches as one of `count` rows; along the second axis shorter ones are filled up with zeros."""
  longest = max(part.shape[1] for part in parts)
  padded = [np.pad(part, ((0, 0), (0, longest - part.shape[1]), *((0, 0),) * (part.ndim - 2))) for part in parts]
  return np.concatenate(padded)[:count]


def in_batches(run: Callable[..., Any], *rows: Any, shared: tuple[Any, ...] = ()) -> np.ndarray:
  """run(*rows, *shared) -> (B, T, ...) in batches; rows: trees of arrays (B, ...) or None, shared: the same for all."""
  count = len(jax.tree.leaves(rows)[0])
  parts = [np.asarray(run(*select(rows, index), *shared)) for index in batches(count)]
  return joined(parts, count)


def select(tree: Any, index: np.ndarray) -> Any:
  """The rows of a tree of arrays and keys, without compiling anything."""
  return jax.tree.map(functools.partial(_select, index), tree)


def _select(index, array):
  is_key = jax.numpy.issubdtype(array.dtype, jax.dtypes.prng_key)
  return select_keys(array, index) if is_key else np.asarray(array)[index]
