"""Batches of fixed sizes, so that any number of motions runs the same few compiled programs."""
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.models.base import select_keys

SIZES = (1, 4, 32)


def batch_sizes(count: int, sizes: Sequence[int] = SIZES) -> list[int]:
  """Sizes of the batches of count motions, each the largest that they fill by half.

  1: 1    3: 4    6: 4 4    40: 32 4 4
  """
  left, found = count, []
  while left > 0:
    found.append(max(size for size in sizes if size <= 2 * left))
    left -= found[-1]
  return found


def in_batches(run: Callable[..., Any], *rows: Any, shared: tuple[Any, ...] = ()) -> np.ndarray:
  """run(*rows, *shared) in batches of fixed sizes; rows: trees of arrays (B, ...) or None, shared: the same for all.

  The last batch is filled up by its last motion, whose copies are dropped. -> (B, ...)
  """
  count = len(jax.tree.leaves(rows)[0])
  made, first = [], 0
  for size in batch_sizes(count):
    here = np.minimum(np.arange(first, first + size), count - 1)
    batch = jax.tree.map(functools.partial(_select, here), rows)
    made.append(np.asarray(run(*batch, *shared))[:count - first])
    first += size
  return np.concatenate(made)


def _select(rows, array):
  """The rows of an array, without compiling anything."""
  is_key = jax.numpy.issubdtype(array.dtype, jax.dtypes.prng_key)
  return select_keys(array, rows) if is_key else np.asarray(array)[rows]
