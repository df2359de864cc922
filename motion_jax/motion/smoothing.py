"""Filters over time of numpy arrays, and of jax arrays, where they are differentiable and work inside jit.

`gaussian_filter1d` and `find_peaks` give what scipy's functions of these names give. Every command smooths motion, and
importing scipy takes as long as sampling does.
"""
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.shapes import Float
from motion_jax.utils.lazy import jax, jnp


def gaussian(values: Float[A, "*lead t k"], sigma: float) -> Float[A, "*lead t k"]:
  """Values (..., T, K) under a Gaussian of sigma frames; the first and last frame continue beyond the ends."""
  if rot.namespace(values) is np:
    return gaussian_filter1d(values, sigma, axis=-2, mode="nearest")
  reach = int(4 * sigma + 0.5)
  return _convolve(values, gaussian_filter1d(np.eye(1, 2 * reach + 1, reach)[0], sigma, mode="constant"), "edge")


_PADS: dict[str, Any] = {"nearest": "edge", "reflect": "symmetric", "constant": "constant"}


def gaussian_filter1d(values: Any, sigma: float, axis: int = -1, mode: str = "reflect", truncate: float = 4.0) -> Any:
  """Values under a Gaussian of sigma samples along an axis, summed in float64 in the order of scipy's.

  mode: beyond the ends stand the values mirrored ("reflect"), the last one ("nearest") or zeros ("constant").
  """
  reach = int(truncate * float(sigma) + 0.5)
  weights = np.exp(-0.5 / (sigma * sigma) * np.arange(-reach, reach + 1) ** 2)
  weights = weights / weights.sum()
  rows = np.moveaxis(np.asarray(values), axis, 0)
  padded = np.pad(rows.astype(float), ((reach, reach),) + ((0, 0),) * (rows.ndim - 1), mode=_PADS[mode])
  at = lambda offset: padded[reach + offset:reach + offset + len(rows)]
  found = at(0) * weights[reach]
  for offset in range(-reach, 0):
    found += (at(offset) + at(-offset)) * weights[reach + offset]
  return np.moveaxis(found.astype(rows.dtype), 0, axis)


def find_peaks(values: np.ndarray, height: float | None = None, distance: int = 1, prominence: float = 0.0
               ) -> np.ndarray:
  """Places of the local maxima of values (T,), of a flat one its middle, that are at least so high, so far from a
  higher one, and so prominent: above the higher of the lowest values between them and a higher value on either side.
  """
  change = np.flatnonzero(np.diff(values) != 0)
  first, last = np.concatenate([[0], change + 1]), np.concatenate([change, [len(values) - 1]])  # of equal values
  level = values[first]
  is_peak = np.zeros(len(level), bool)
  is_peak[1:-1] = (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
  peaks = ((first + last) // 2)[is_peak]
  if height is not None:
    peaks = peaks[values[peaks] >= height]
  kept = np.ones(len(peaks), bool)
  for i in np.argsort(values[peaks])[::-1] if distance > 1 else ():  # the highest first, as scipy orders equal ones
    if kept[i]:
      kept &= (np.abs(peaks - peaks[i]) >= distance) | (np.arange(len(peaks)) == i)
  return np.array([peak for peak in peaks[kept] if not prominence or _prominence(values, peak) >= prominence], int)


def _prominence(values, peak):
  higher = np.flatnonzero(values > values[peak])
  before, after = higher[higher < peak], higher[higher > peak]
  left = values[(before[-1] + 1 if len(before) else 0):peak + 1]
  right = values[peak:(after[0] if len(after) else len(values))]
  return values[peak] - max(left.min(), right.min())


def moving_average(values: Float[A, "*lead t k"], window: int) -> Float[A, "*lead t k"]:
  """Mean over `window` frames around each of values (..., T, K), zeros beyond the ends."""
  from scipy.ndimage import uniform_filter1d
  if rot.namespace(values) is np:
    return uniform_filter1d(values, window, axis=-2, mode="constant")
  return _convolve(values, np.full(window, 1 / window), "constant")


def _convolve(values: Any, kernel: Float[np.ndarray, " n"], mode: str) -> Any:
  """Values (..., T, K) correlated with a kernel over time, padded at the ends as `jnp.pad` does in mode."""
  rows: Any = jnp.moveaxis(values, -2, -1)
  before, after = len(kernel) // 2, (len(kernel) - 1) // 2
  padded = jnp.pad(rows, ((0, 0),) * (rows.ndim - 1) + ((before, after),), mode=mode)
  flat = padded.reshape(-1, 1, padded.shape[-1])
  found = jax.lax.conv_general_dilated(flat, jnp.asarray(kernel, values.dtype)[None, None], (1,), "VALID",
                                       precision="highest")
  return jnp.moveaxis(found.reshape(rows.shape), -1, -2)


def smoothstep(share: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
  """A share of a way, below 0 before it and above 1 after it, that begins and ends slowly."""
  part = np.clip(share, 0.0, 1.0)
  return part * part * (3 - 2 * part)
