"""Rotations in one convention: quaternions (w, x, y, z), Hamilton product, matrices act on column vectors.

`multiply(p, q)` turns by q first. Every function takes numpy or jax arrays of any leading shape and returns the same
kind; what it computes is float64 if the input is. On jax arrays each is differentiable everywhere: where a direction is
undefined (a vector of no length) the result is finite and its gradient 0.
"""
import sys
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.lazy import is_jax

if TYPE_CHECKING:
  import jax
  A = TypeVar("A", jax.Array, np.ndarray)  # numpy in, numpy out
else:
  A = TypeVar("A")


def namespace(*arrays: Any) -> Any:
  """jax.numpy if any array is a jax array (or tracer), else numpy."""
  return sys.modules["jax.numpy"] if any(map(is_jax, arrays)) else np


def sqrt(x: Num[A, "*lead"]) -> Float[A, "*lead"]:
  """Square root whose gradient at 0 is 0, not infinite."""
  xp = namespace(x)
  return xp.sqrt(x) if xp is np else xp.where(x == 0, 0, xp.sqrt(xp.where(x == 0, 1, x)))


def length(v: Num[A, "*lead k"]) -> Float[A, "*lead"]:
  """Euclidean length of vectors (..., K); its gradient at 0 is 0."""
  xp = namespace(v)
  if xp is np:
    return xp.linalg.norm(v, axis=-1)
  return sqrt((v * v).sum(-1))


def arctan2(y: Num[A, "*lead"], x: Num[A, "*lead"]) -> Float[A, "*lead"]:
  """Angle in radians of the point (x, y); its gradient at (0, 0) is 0."""
  xp = namespace(y, x)
  return xp.arctan2(y, x if xp is np else xp.where((x == 0) & (y == 0), 1, x))


def unit(v: Float[A, "*lead k"], eps: float = 0.0) -> Float[A, "*lead k"]:
  """Scales vectors (..., K) to length 1. With eps > 0, or on jax arrays, a zero vector stays zero."""
  size = sqrt((v * v).sum(-1, keepdims=True))
  if eps:
    return v / namespace(v).maximum(size, eps)
  xp = namespace(v)
  return v / (size if xp is np else xp.where(size == 0, 1, size))


def multiply(p: Float[A, "*#lead 4"], q: Float[A, "*#lead 4"]) -> Float[A, "*lead 4"]:
  """Hamilton product p q of quaternions (..., 4): turns by q, then by p."""
  xp = namespace(p, q)
  pw, pv, qw, qv = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
  w = pw * qw - (pv * qv).sum(-1, keepdims=True)
  return xp.concatenate([w, pw * qv + qw * pv + xp.cross(pv, qv)], axis=-1)


def conjugate(q: Float[A, "*lead 4"]) -> Float[A, "*lead 4"]:
  """The inverse of unit quaternions (..., 4)."""
  xp = namespace(q)
  return xp.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def rotate(q: Float[A, "*#lead 4"], v: Num[A, "*#lead 3"]) -> Float[A, "*lead 3"]:
  """Turns vectors v (..., 3) by unit quaternions q (..., 4); the leading shapes broadcast."""
  xp = namespace(q, v)
  shape = xp.broadcast_shapes(q.shape[:-1], v.shape[:-1])
  q, v = xp.broadcast_to(q, shape + (4,)), xp.broadcast_to(v, shape + (3,))
  w, u = q[..., :1], q[..., 1:]
  cross = xp.cross(u, v)
  return v + 2 * (w * cross + xp.cross(u, cross))


def between(a: Float[A, "*#lead 3"], b: Float[A, "*#lead 3"]) -> Float[A, "*lead 4"]:
  """The smallest turn from direction a to direction b, (..., 3) each: normalized [|a||b| + a.b, a x b], so w >= 0.

  Opposite directions have many smallest turns; the one taken is about the vertical, as far as that is across a, so that
  a body which faces backwards is not turned upside down.
  """
  # Parity: the reference divides 0 by 0 where directions are exactly opposite.
  xp = namespace(a, b)
  size = sqrt((a * a).sum(-1, keepdims=True) * (b * b).sum(-1, keepdims=True))
  w, axis = size + (a * b).sum(-1, keepdims=True), xp.cross(a, b)
  tiny = 64 * xp.finfo(axis.dtype).eps * size  # below it the cross product is rounding
  opposite = (w < tiny) & ((axis * axis).sum(-1, keepdims=True) <= tiny * tiny)
  upright = (a * a)[..., ::2].sum(-1, keepdims=True) > 1e-6 * (a * a).sum(-1, keepdims=True)
  guide = xp.where(upright, xp.asarray((0, 1, 0), axis.dtype), xp.asarray((1, 0, 0), axis.dtype))
  across = guide * (a * a).sum(-1, keepdims=True) - a * (guide * a).sum(-1, keepdims=True)
  w = xp.where(opposite, 0, w)
  if xp is not np:
    w = xp.where(size == 0, 1, w)  # a vector of no length: no rotation
  return unit(xp.concatenate([w, xp.where(opposite, across, axis)], axis=-1))


def about_axis(angle: float | Float[A, "*lead"], axis: str) -> Float[A, "*lead 4"]:
  """Quaternions (..., 4) that turn by angle (...) radians about a coordinate axis "x", "y" or "z"."""
  xp = namespace(angle)
  zero, half = xp.zeros_like(angle), angle / 2
  parts = [xp.cos(half), zero, zero, zero]
  parts["xyz".index(axis) + 1] = xp.sin(half)
  return xp.stack(parts, axis=-1)


def rotate_about_y(points: Num[np.ndarray, "*lead 3"], angle: Any) -> Float[np.ndarray, "*shape 3"]:
  """Rotates points (..., 3) about y by angles (...), radians, from z to x (to the left); float64 numpy."""
  x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
  sin, cos = np.sin(angle), np.cos(angle)
  return np.stack(np.broadcast_arrays(cos * x + sin * z, y, cos * z - sin * x), -1)


def from_vector(v: Float[A, "*lead 3"]) -> Float[A, "*lead 4"]:
  """Rotation vectors (..., 3), axis times angle in radians as SMPL's poses are, to quaternions (..., 4)."""
  xp = namespace(v)
  size = sqrt((v * v).sum(-1, keepdims=True))
  small = size < 1e-6
  scale = xp.where(small, 0.5, xp.sin(size / 2) / xp.where(small, 1.0, size))
  return xp.concatenate([xp.cos(size / 2), v * scale], axis=-1)


def to_vector(q: Float[A, "*lead 4"]) -> Float[A, "*lead 3"]:
  """Quaternions (..., 4) to rotation vectors (..., 3), their angles 0 to pi."""
  xp = namespace(q)
  q = xp.where(q[..., :1] < 0, -q, q)
  sine = sqrt((q[..., 1:] ** 2).sum(-1, keepdims=True))
  turn = 2 * arctan2(sine, q[..., :1])
  return q[..., 1:] * xp.where(sine < 1e-9, 2.0, turn / xp.where(sine < 1e-9, 1.0, sine))


def best_turn(bones: Float[A, "*lead n 3"], shape: Float[Array, "n 3"]) -> Float[A, "*lead 3 3"]:
  """Rotation matrices (..., 3, 3) that bring vectors shape (N, 3) nearest to bones (..., N, 3): least squares (Kabsch).
  """
  xp = namespace(bones)
  products = xp.einsum("...ni,nj->...ij", bones, shape)
  if xp is np:
    return nearest_rotation(products)
  from motion_jax.motion.rotation_gradients import with_derivative
  return with_derivative(nearest_rotation)(products)


def nearest_rotation(m: Float[A, "*lead 3 3"]) -> Float[A, "*lead 3 3"]:
  """The rotation matrices nearest to m (..., 3, 3)."""
  xp = namespace(m)
  u, _, vt = xp.linalg.svd(m)
  flip = xp.linalg.det(u @ vt)[..., None, None]
  return xp.concatenate([u[..., :2], u[..., 2:] * flip], axis=-1) @ vt


def to_matrix(q: Float[A, "*lead 4"]) -> Float[A, "*lead 3 3"]:
  """Unit quaternions (..., 4) to matrices (..., 3, 3)."""
  xp = namespace(q)
  w, x, y, z = (q[..., i] for i in range(4))
  rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
          2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
  return xp.stack(rows, axis=-1).reshape(q.shape[:-1] + (3, 3))


def from_matrix(m: Float[A, "*lead 3 3"]) -> Float[A, "*lead 4"]:
  """Rotation matrices (..., 3, 3) to unit quaternions (..., 4) with w >= 0.

  Each of the four components is the safest to divide by somewhere; the largest is taken, so no angle is special.
  """
  xp = namespace(m)
  m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
  a, b, c = m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]
  d, e, f = m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]
  rows = xp.stack([
      xp.stack([1 + m00 + m11 + m22, a - d, b - e, c - f], -1),
      xp.stack([a - d, 1 + m00 - m11 - m22, c + f, b + e], -1),
      xp.stack([b - e, c + f, 1 - m00 + m11 - m22, a + d], -1),
      xp.stack([c - f, b + e, a + d, 1 - m00 - m11 + m22], -1)], -2)
  best = xp.argmax(xp.stack([rows[..., i, i] for i in range(4)], -1), axis=-1)
  q = unit(xp.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :])
  return xp.where(q[..., :1] < 0, -q, q)


def to_6d(q: Float[A, "*lead 4"]) -> Float[A, "*lead 6"]:
  """Quaternions (..., 4) to the first column, then the second column of their matrix, (..., 6)."""
  xp = namespace(q)
  m = to_matrix(q)
  return xp.concatenate([m[..., :, 0], m[..., :, 1]], axis=-1)


def matrix_from_6d(d: Float[A, "*lead 6"]) -> Float[A, "*lead 3 3"]:
  """Two columns (..., 6), not necessarily orthonormal, to matrices (..., 3, 3): z = x cross y_raw, y = z cross x."""
  xp = namespace(d)
  x = unit(d[..., :3])
  z = unit(xp.cross(x, d[..., 3:]))
  return xp.stack([x, xp.cross(z, x), z], axis=-1)


def continuous(q: Float[np.ndarray, "t *lead 4"]) -> Float[np.ndarray, "t *lead 4"]:
  """Picks signs of quaternions (T, ..., 4) so that none jumps to its negative from one frame to the next."""
  dots = (q[1:] * q[:-1]).sum(-1)
  signs = np.cumprod(np.where(dots < 0, -1.0, 1.0), axis=0)
  return np.concatenate([q[:1], q[1:] * signs[..., None]])


def slerp(p: Float[A, "*#lead 4"], q: Float[A, "*#lead 4"], weight: float | Float[A, "*#lead"]
          ) -> Float[A, "*lead 4"]:
  """Between unit quaternions p and q (..., 4) on the shorter arc; weight (...) is 0 at p and 1 at q."""
  xp = namespace(p, q)
  dot = (p * q).sum(-1, keepdims=True)
  q = xp.where(dot < 0, -q, q)
  angle = xp.arccos(xp.clip(xp.abs(dot), 0, 1))
  weight = xp.asarray(weight)[..., None]
  near = angle < 1e-6
  sine = xp.where(near, 1.0, xp.sin(angle))
  a = xp.where(near, 1 - weight, xp.sin((1 - weight) * angle) / sine)
  b = xp.where(near, weight, xp.sin(weight * angle) / sine)
  return unit(a * p + b * q)
