"""Derivatives of rotations that JAX's own rules do not give; apart, because the numpy side loads no JAX."""
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


@functools.cache
def with_derivative(nearest: Callable[[Any], Any]) -> Callable[[Any], Any]:
  """`rotations.nearest_rotation`, on jax arrays (..., 3, 3), with a finite derivative."""

  @jax.custom_jvp
  def nearest_rotation(m: jax.Array) -> jax.Array:
    with jax.default_matmul_precision("highest"):
      return nearest(m)

  @nearest_rotation.defjvp
  def _jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    """With m = R S, S symmetric, and dR = R [w]x: (tr(S) I - S) w is the axial vector of R^T dm.

    Unlike the derivative of an SVD this is finite where singular values are equal; where the rotation is undefined (all
    bones on one line) the least-squares solution is taken, which leaves the turn about that line alone.
    """
    (m,), (dm,) = primals, tangents
    with jax.default_matmul_precision("highest"):
      turn = nearest_rotation(m)
      inverse = jnp.swapaxes(turn, -1, -2)
      stretch, change = inverse @ m, inverse @ dm
      trace = jnp.trace(stretch, axis1=-2, axis2=-1)[..., None, None]
      axial = jnp.stack([change[..., 2, 1] - change[..., 1, 2], change[..., 0, 2] - change[..., 2, 0],
                         change[..., 1, 0] - change[..., 0, 1]], -1)
      w = (jnp.linalg.pinv(trace * jnp.eye(3, dtype=m.dtype) - stretch, hermitian=True) @ axial[..., None])[..., 0]
      skew = jnp.cross(w[..., None, :], jnp.eye(3, dtype=m.dtype))  # rows: w x e_i, the columns of [w]x
      return turn, turn @ jnp.swapaxes(skew, -1, -2)

  return nearest_rotation
