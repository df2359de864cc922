"""Curves through way points: where a path is at each time, evenly gone along where none are given. numpy, float64."""
import numpy as np
from jaxtyping import Float

_FINE = 40  # places of a curve between two way points, by which its length is measured


def through(points: Float[np.ndarray, "n k"], times: Float[np.ndarray, " n"], at: Float[np.ndarray, " t"]
            ) -> Float[np.ndarray, "t k"]:
  """A smooth curve (T, K) at seconds `at` (T,) that is at points (N, K) at times (N,), rising: cubic pieces whose
  slope at a point is that of the parabola through it and its neighbours."""
  from scipy.interpolate import CubicHermiteSpline
  if len(points) == 1:
    return np.repeat(points, len(at), axis=0)
  slope = np.gradient(points, times, axis=0, edge_order=2 if len(points) > 2 else 1)
  return CubicHermiteSpline(times, points, slope)(np.clip(at, times[0], times[-1]))


def evenly(points: Float[np.ndarray, "n k"], shares: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
  """The curve (T, K) through points (N, K) at shares (T,) of its length, 0 to 1: gone along at one speed."""
  curve = _fine(points)
  gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=-1)))
  if not gone[-1] > 0:
    return np.repeat(points[:1], len(shares), axis=0)
  return np.stack([np.interp(shares * gone[-1], gone, column) for column in curve.T], -1)


def length(points: Float[np.ndarray, "n k"]) -> float:
  """Metres of the curve through points (N, K)."""
  return float(np.linalg.norm(np.diff(_fine(points), axis=0), axis=-1).sum())


def _fine(points):
  """The curve through points in small steps: centripetal, that is in times by the root of their distances, so that it
  makes no loops where points are near one another."""
  apart = np.sqrt(np.linalg.norm(np.diff(points, axis=0), axis=-1))
  keep = np.append(True, apart > 1e-6)
  points, apart = points[keep], apart[keep[1:]]
  if len(points) < 2:
    return points
  times = np.append(0.0, np.cumsum(apart))
  return through(points, times, np.linspace(0, times[-1], _FINE * len(apart) + 1))
