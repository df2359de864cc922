"""Filters over time, of numpy arrays and of jax arrays (differentiable, inside jit).

`gaussian_filter1d` and `find_peaks` equal scipy's functions of these names; importing scipy takes as long as sampling.
"""
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.shapes import Float, Num
from motion_jax.utils.lazy import jax, jnp


def gaussian(values: Float[A, "*lead t k"], sigma: float) -> Float[A, "*lead t k"]:
  """Smooths values (..., T, K) by a Gaussian of sigma frames; the first and last frame continue beyond the ends."""
  if rot.namespace(values) is np:
    return gaussian_filter1d(values, sigma, axis=-2, mode="nearest")
  reach = int(4 * sigma + 0.5)
  return _convolve(values, gaussian_filter1d(np.eye(1, 2 * reach + 1, reach)[0], sigma, mode="constant"), "edge")


def gaussian_along_path(points: Num[np.ndarray, "t k"], sigma: float, pad: int, span: int) -> Float[np.ndarray, "t k"]:
  """Smooths points (T, K) by a Gaussian of sigma frames, after extrapolating both ends linearly by `pad` frames.

  span: frames at each end whose mean velocity is continued. Without extrapolation, a filter slows the ends down.
  """
  span = min(span, len(points) - 1)
  far = np.arange(1, pad + 1)[:, None] / max(span, 1)
  long = np.concatenate([points[0] + far[::-1] * (points[0] - points[span]), points,
                         points[-1] + far * (points[-1] - points[-1 - span])])
  return gaussian_filter1d(long, sigma, axis=0)[pad:len(long) - pad]


_PADS: dict[str, Any] = {"nearest": "edge", "reflect": "symmetric", "constant": "constant"}


def gaussian_filter1d(values: Any, sigma: float, axis: int = -1, mode: str = "reflect", truncate: float = 4.0) -> Any:
  """Smooths values by a Gaussian of sigma samples along an axis; float64 sums in the order of scipy's.

  mode: padding beyond the ends: mirrored values ("reflect"), the last value ("nearest") or zeros ("constant").
  """
  reach = int(truncate * float(sigma) + 0.5)
  weights = np.exp(-0.5 / (sigma * sigma) * np.arange(-reach, reach + 1) ** 2)
  weights = weights / weights.sum()
  rows = np.moveaxis(np.asarray(values), axis, 0)
  padded = np.pad(rows.astype(float), ((reach, reach),) + ((0, 0),) * (rows.ndim - 1), mode=_PADS[mode])
  at = lambda offset: padded[reach + offset:reach + offset + len(rows)]
  total = at(0) * weights[reach]
  for offset in range(-reach, 0):
    total += (at(offset) + at(-offset)) * weights[reach + offset]
  return np.moveaxis(total.astype(rows.dtype), 0, axis)


def find_peaks(values: np.ndarray, height: float | None = None, distance: int = 1, prominence: float = 0.0
               ) -> np.ndarray:
  """Indices of the local maxima of values (T,), the middle of flat ones, filtered as by `scipy.signal.find_peaks`:
  by minimum height, distance from a higher peak, and prominence above the higher of the two neighbouring valleys.
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
  """Moving average of values (..., T, K) over `window` frames, with zeros beyond the ends."""
  from scipy.ndimage import uniform_filter1d
  if rot.namespace(values) is np:
    return uniform_filter1d(values, window, axis=-2, mode="constant")
  return _convolve(values, np.full(window, 1 / window), "constant")


def _convolve(values: Any, kernel: Float[np.ndarray, " n"], mode: str) -> Any:
  """Correlates values (..., T, K) with a kernel over time; mode: padding, as of `jnp.pad`."""
  rows: Any = jnp.moveaxis(values, -2, -1)
  before, after = len(kernel) // 2, (len(kernel) - 1) // 2
  padded = jnp.pad(rows, ((0, 0),) * (rows.ndim - 1) + ((before, after),), mode=mode)
  flat = padded.reshape(-1, 1, padded.shape[-1])
  filtered = jax.lax.conv_general_dilated(flat, jnp.asarray(kernel, values.dtype)[None, None], (1,), "VALID",
                                       precision="highest")
  return jnp.moveaxis(filtered.reshape(rows.shape), -1, -2)


def smoothstep(share: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
  """Cubic ease-in and ease-out: 3 x^2 - 2 x^3 of a share x (T,), clipped to 0..1."""
  part = np.clip(share, 0.0, 1.0)
  return part * part * (3 - 2 * part)
