"""Streaming FID and diversity, for embeddings that do not fit into memory.

  generated = accumulate.start()
  for chunk in chunks:
    generated = accumulate.add(generated, chunk, rng)
  scores.fid(real.moments, generated.moments), accumulate.diversity(generated)

Results do not depend on the chunks: diversity exactly, FID up to rounding.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.metrics import scores
from motion_jax.shapes import Array, Num


class Passed(NamedTuple):
  """State of the accumulation: moments of all rows so far, and two independent draws without replacement.

  Every row gets two random keys; the rows of the lowest keys, in the order of keys, are a draw. keys (2, K), sorted;
  rows (2, K, E), K at most `size`.
  """
  size: int
  moments: scores.Moments | None = None
  keys: np.ndarray | None = None
  rows: np.ndarray | None = None


def start(size: int = 300) -> Passed:
  """Initial state; size: rows to keep for each of the two draws of diversity."""
  if size < 1:
    raise ValueError(f"got a draw of {size} rows, expected 1 or more")
  return Passed(size)


def add(passed: Passed, features: Num[Array, "n e"], rng: np.random.Generator) -> Passed:
  """Adds a chunk of embeddings (N, E), of any length; rng: a numpy generator, the same one for all chunks."""
  merged = scores.moments(features)  # raises ValueError for a wrong shape, NaN or infinity
  rows = np.broadcast_to(np.asarray(features, np.float64), (2, *np.shape(features)))
  keys = rng.random((len(features), 2)).T  # two numbers per row, in the order of rows: independent of chunks
  if passed.moments is not None and passed.rows is not None:
    if rows.shape[-1] != passed.rows.shape[-1]:
      raise ValueError(f"got embeddings of {rows.shape[-1]} numbers after others of {passed.rows.shape[-1]}; one "
                       "evaluator makes them all")
    merged = scores.merge(passed.moments, merged)
    keys, rows = np.concatenate([passed.keys, keys], 1), np.concatenate([passed.rows, rows], 1)
  lowest = np.argsort(keys, axis=1, kind="stable")[:, :passed.size]
  return Passed(passed.size, merged, np.take_along_axis(keys, lowest, 1),
                np.take_along_axis(rows, lowest[..., None], 1))


def diversity(passed: Passed, size: int | None = None) -> float:
  """Mean distance between two independent draws of `size` rows without replacement (None: all kept rows)."""
  if passed.rows is None:
    raise ValueError("no embeddings have passed by yet")
  size = passed.rows.shape[1] if size is None else size
  if not 1 <= size <= passed.rows.shape[1]:
    raise ValueError(f"got a draw of {size} rows, {passed.rows.shape[1]} were kept; start with a larger size, or add "
                     "more samples")
  first, second = passed.rows[:, :size]
  return float(np.linalg.norm(first - second, axis=1).mean())
