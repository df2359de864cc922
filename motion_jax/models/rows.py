"""Motions side by side in batches of few sizes: each size is compiled once, so any number of motions compiles nothing.

A motion's numbers do not depend on its neighbours, so a batch is filled up with copies of its last motion.
"""
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

MANY = 4  # rows of a batch of several; with more of them two cores are no faster (docs/lab/speed.md#batches)


def batches(count: int) -> Iterator[np.ndarray]:
  """Indices of `count` motions in batches of `MANY`, the last index repeated to fill one up, or of one: two motions
  take as long one after the other as a batch that is half empty."""
  first = 0
  while first < count:
    size = MANY if count - first > MANY // 2 else 1
    yield np.minimum(np.arange(first, first + size), count - 1)
    first += size


def joined(parts: Sequence[Any], count: int) -> np.ndarray:
  """Arrays of the batches as one of `count` rows; along the second axis shorter ones are filled up with zeros."""
  longest = max(part.shape[1] for part in parts)
  padded = [np.pad(part, ((0, 0), (0, longest - part.shape[1]), *((0, 0),) * (part.ndim - 2))) for part in parts]
  return np.concatenate(padded)[:count]
