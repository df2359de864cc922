"""Paths on the floor: smooth curves through waypoints, and standard curves for tests of path following.

The standard curves (`CURVES`) begin at the origin in the direction of +z, as motions do. numpy, float64.
"""
from collections.abc import Callable

import numpy as np

from motion_jax.shapes import Float, Num

_FINE = 40  # samples between two waypoints for measuring the length of a curve


def through(points: Float[np.ndarray, "n k"], times: Float[np.ndarray, " n"], at: Float[np.ndarray, " t"]
            ) -> Float[np.ndarray, "t k"]:
  """Smooth curve through points (N, K) at increasing times (N,), evaluated at seconds `at` (T,): (T, K).

  Cubic pieces; the slope at a point is that of the parabola through it and its neighbours.
  """
  from scipy.interpolate import CubicHermiteSpline
  if len(points) == 1:
    return np.repeat(points, len(at), axis=0)
  slope = np.gradient(points, times, axis=0, edge_order=2 if len(points) > 2 else 1)
  return CubicHermiteSpline(times, points, slope)(np.clip(at, times[0], times[-1]))


def evenly(points: Float[np.ndarray, "n k"], shares: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
  """Points (T, K) on the curve through points (N, K) at relative arc lengths (T,), 0 to 1."""
  curve = _fine(points)
  gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=-1)))
  if not gone[-1] > 0:
    return np.repeat(points[:1], len(shares), axis=0)
  return np.stack([np.interp(shares * gone[-1], gone, column) for column in curve.T], -1)


def length(points: Float[np.ndarray, "n k"]) -> float:
  """Length of the curve through points (N, K), metres."""
  return float(np.linalg.norm(np.diff(_fine(points), axis=0), axis=-1).sum())


def _fine(points):
  """The curve through points in small steps, with centripetal parameters (square roots of distances), which avoid loops
  between close points."""
  apart = np.sqrt(np.linalg.norm(np.diff(points, axis=0), axis=-1))
  keep = np.append(True, apart > 1e-6)
  points, apart = points[keep], apart[keep[1:]]
  if len(points) < 2:
    return points
  times = np.append(0.0, np.cumsum(apart))
  return through(points, times, np.linspace(0, times[-1], _FINE * len(apart) + 1))


# --- standard curves: shapes that are not in the training data --------------------------------------------------

SPEED = 1.2  # metres a second


def _walked(points: Num[np.ndarray, "n 2"], fps: float, speed: float) -> Float[np.ndarray, "t 2"]:
  """Points (T, 2) at constant speed along the polyline through points (N, 2)."""
  way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=-1))])
  at = np.arange(int(way[-1] / speed * fps) + 1) * speed / fps
  return np.stack([np.interp(at, way, points[:, i]) for i in range(2)], axis=-1)


def _round(radius: float, side: int) -> Float[np.ndarray, "n 2"]:
  angle = np.linspace(0, 2 * np.pi, 720)
  return np.stack([side * radius * (1 - np.cos(angle)), radius * np.sin(angle)], -1)


def circle(fps: float, radius: float = 2.0) -> Float[np.ndarray, "t 2"]:
  """A circle to the left."""
  return _walked(_round(radius, 1), fps, SPEED)


def figure_of_eight(fps: float, radius: float = 1.2) -> Float[np.ndarray, "t 2"]:
  """A figure of eight: a circle to the left, then one to the right."""
  return _walked(np.concatenate([_round(radius, 1), _round(radius, -1)[1:]]), fps, SPEED)


def slalom(fps: float, width: float = 0.7, wave: float = 4.0, length: float = 10.0) -> Float[np.ndarray, "t 2"]:
  """A sine wave about +z whose amplitude grows over the first wave."""
  z = np.linspace(0, length, 720)
  x = width * np.minimum(z / wave, 1) ** 2 * np.sin(2 * np.pi * z / wave)
  return _walked(np.stack([x, z], -1), fps, SPEED)


def corner(fps: float, length: float = 4.0) -> Float[np.ndarray, "t 2"]:
  """A right-angled corner to the left, with two legs of `length` metres."""
  return _walked(np.array([[0.0, 0.0], [0.0, length], [length, length]]), fps, SPEED)


def stop_and_go(fps: float) -> Float[np.ndarray, "t 2"]:
  """Two seconds of walking, two of standing, twice, with transitions of half a second."""
  seconds = np.arange(int(8 * fps) + 1) / fps
  speed = SPEED * np.interp(seconds % 4, [0, 1.75, 2.25, 3.75, 4], [1, 1, 0, 0, 0.5])
  return np.stack([0 * seconds, np.concatenate([[0.0], np.cumsum(speed[:-1])]) / fps], -1)


CURVES: dict[str, Callable[[float], Float[np.ndarray, "t 2"]]] = {
    "circle": circle, "figure of eight": figure_of_eight, "slalom": slalom, "corner": corner,
    "stop and go": stop_and_go}
