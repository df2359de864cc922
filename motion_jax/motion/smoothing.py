"""Filters over time of numpy arrays (scipy's) and jax arrays, where they are differentiable and work inside jit."""
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A


def gaussian(values: Float[A, "*lead t k"], sigma: float) -> Float[A, "*lead t k"]:
  """Values (..., T, K) under a Gaussian of sigma frames; the first and last frame continue beyond the ends."""
  from scipy.ndimage import gaussian_filter1d
  if rot.namespace(values) is np:
    return gaussian_filter1d(values, sigma, axis=-2, mode="nearest")
  reach = int(4 * sigma + 0.5)
  return _convolve(values, gaussian_filter1d(np.eye(1, 2 * reach + 1, reach)[0], sigma, mode="constant"), "edge")


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
