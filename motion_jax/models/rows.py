"""Motions side by side in batches of few sizes: each size is compiled once, so any number of motions compiles nothing.

A motion's numbers do not depend on its neighbours, so a batch is filled up with copies of its last motion.
"""
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

ROWS = (1, 4)  # sizes of a batch (docs/lab/speed.md#batches)


def batches(count: int, sizes: Sequence[int] = ROWS) -> Iterator[np.ndarray]:
  """Indices of `count` motions in batches whose lengths are all in sizes; the last index is repeated to fill one up."""
  first = 0
  while first < count:
    size = next((size for size in sizes if size >= count - first), sizes[-1])
    yield np.minimum(np.arange(first, first + size), count - 1)
    first += size


def joined(parts: Sequence[Any], count: int) -> np.ndarray:
  """Arrays of the batches as one of `count` rows; along the second axis shorter ones are filled up with zeros."""
  longest = max(part.shape[1] for part in parts)
  padded = [np.pad(part, ((0, 0), (0, longest - part.shape[1]), *((0, 0),) * (part.ndim - 2))) for part in parts]
  return np.concatenate(padded)[:count]
