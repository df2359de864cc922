"""Bootstrap over test clips: how far a row, or the difference of two rows, would vary with other clips.

Replications draw other captions, cuts and noise of the same clips, so their interval does not cover other clips. Here
clips are resampled with replacement; two rows are compared on the same draws, because they have the same captions.
"""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

DRAWS, FID_DRAWS = 1_000, 60


class ByMotion(NamedTuple):
  """The values of each motion of a row in one replication: item (N,) of the test set, values {metric: (N,)} whose means
  the row shows, and the vectors (N, E) of FID, of the real motions and of the row's.
  """
  item: np.ndarray
  values: dict[str, np.ndarray]
  real: np.ndarray
  generated: np.ndarray


def over_clips(own: Sequence[ByMotion], other: Sequence[ByMotion] | None = None, seed: int = 0) -> dict[str, dict]:
  """{metric: {"mean", "interval"}} of a row, or of the row minus another; both are a `ByMotion` for each replication.

  interval: half of the 95 % interval, 1.96 standard deviations of the bootstrap draws. A draw of FID is of one
  replication.
  """
  rng = np.random.default_rng(seed)
  item = np.concatenate([replication.item for replication in own])
  _, place, count = np.unique(item, return_inverse=True, return_counts=True)
  chosen = rng.integers(len(count), size=(DRAWS, len(count)))
  intervals = {}
  for metric in own[0].values:
    if other is None or metric in other[0].values:
      value = _joined(own, metric) - (0 if other is None else _joined(other, metric))
      of_clip = np.bincount(place, value) / count
      intervals[metric] = _interval(value.mean(), of_clip[chosen].mean(1))
  fids = [_fid(own, other, i % len(own), rng.integers(len(own[0].item), size=len(own[0].item)))
          for i in range(FID_DRAWS)]
  whole = [_fid(own, other, i, slice(None)) for i in range(len(own))]
  return {"fid": _interval(np.mean(whole), fids)} | intervals


def _joined(replications, metric):
  return np.concatenate([replication.values[metric] for replication in replications])


def _interval(mean, draws):
  return {"mean": float(mean), "interval": float(1.96 * np.std(draws))}


def _fid(own, other, replication, chosen):
  """FID of a row's motions at the chosen indices, minus that of another row."""
  real = _gaussian(own[replication].real[chosen])
  fid = _frechet(real, _gaussian(own[replication].generated[chosen]))
  return fid - _frechet(real, _gaussian(other[replication].generated[chosen])) if other else fid


def _gaussian(x):
  """(mean (E,), factor (R, E) of the covariance factor^T factor) of rows (N, E)."""
  x = np.asarray(x, np.float64)
  mean = x.mean(0)
  return mean, np.linalg.qr((x - mean) / np.sqrt(len(x) - 1), mode="r")


def _frechet(a, b):
  """`scores.frechet_distance` from factors, without a matrix square root: hundreds of draws take seconds."""
  (mean_a, factor_a), (mean_b, factor_b) = a, b
  shared = np.linalg.svd(factor_a @ factor_b.T, compute_uv=False).sum()
  return float(((mean_a - mean_b) ** 2).sum() + (factor_a**2).sum() + (factor_b**2).sum() - 2 * shared)
