"""Smoothness in time as banded symmetric matrices: (3, T), the diagonal and the two below it. numpy, float64."""
import numpy as np
from jaxtyping import Bool, Float


def second_differences(count: int, weights: Float[np.ndarray, " n"] | float = 1.0) -> Float[np.ndarray, "3 t"]:
  """Bands (3, T), lower form, of the sum of weights (T - 2,) times squared second differences of count numbers."""
  bands = np.zeros((3, count))
  if count > 2:
    for shift, factor in ((0, 1.0), (1, 4.0), (2, 1.0)):
      bands[0, shift:count - 2 + shift] += factor * weights
    bands[1, :count - 2] -= 2.0 * weights
    bands[1, 1:count - 1] -= 2.0 * weights
    bands[2, :count - 2] += weights
  return bands


def times(bands: Float[np.ndarray, "3 t"], x: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "t p"]:
  """The symmetric matrix of these bands (3, T) times x (T, P)."""
  result = bands[0][:, None] * x
  for apart in (1, 2):
    low = bands[apart, :-apart, None]
    result[apart:] += low * x[:-apart]
    result[:-apart] += low * x[apart:]
  return result


def solved(bands: Float[np.ndarray, "3 t"], pushed: Float[np.ndarray, "t k"], values: Float[np.ndarray, "t k"],
           given: Bool[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
  """x (T, K) with bands x = pushed where x is not given (T,) to be one of values. Makes changes in bands and pushed."""
  from scipy.linalg import solveh_banded
  count, fixed = len(values), np.flatnonzero(given)
  for offset in (1, 2):  # what is given moves to the other side of the equations
    for frame in fixed:
      for other, low in ((frame + offset, frame), (frame - offset, frame - offset)):
        if 0 <= other < count:
          pushed[other] -= bands[offset, low] * values[frame]
          bands[offset, low] = 0
  bands[0, fixed], pushed[fixed] = 1.0, values[fixed]
  return solveh_banded(bands, pushed, lower=True)
