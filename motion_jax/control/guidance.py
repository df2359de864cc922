"""Guide latents towards constraints: damped Gauss-Newton steps through a decoder and the joints that it makes.

Latents z have joint positions J(z) that should be c. If z is normal with variances P, and positions are known to a
tolerance s, the most likely change is d = P A' (A P A' + s^2)^-1 (c - J(z)), where A is the derivative of J: the
pseudo-inverse guidance of diffusion models (Song et al., ICLR 2023) with a decoder in between. A is never formed; a few
conjugate gradient steps, one forward and one backward product each, give the same d, separately for each motion.
"""
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from motion_jax.control.signal import ControlSignal
from motion_jax.shapes import Array, Float

TOLERANCE = 0.01  # metres
SETTLING = 6      # conjugate gradient steps of each Gauss-Newton step on finished latents
_TURN = 0.3       # metres: weight of a radian of heading


def residual(signal: ControlSignal, joints: Float[Array, "b t j 3"], heading: Float[Array, "b t"]
             ) -> tuple[Float[Array, "b t j 3"], Float[Array, "b t"]]:
  """Differences of joints (B, T, 22, 3) and headings (B, T) from a signal; 0 for absent targets."""
  turn = jnp.sin(heading - signal.heading)  # beyond 90 degrees its sign only, as the sine decreases again
  turn = jnp.where(jnp.cos(heading - signal.heading) < 0, jnp.sign(turn), turn)
  return (jnp.where(signal.given, joints - signal.positions, 0.0),
          jnp.where(signal.heading_given, _TURN * turn, 0.0))


def _dot(a, b):
  """Inner products (B,) of two trees with leaves (B, ...)."""
  return sum((x * y).reshape(x.shape[0], -1).sum(1) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b)))


def newton_step(residual_of: Callable[..., Any], z: Float[Array, "b l c"], variance: Float[Array, "#b l 1"],
                num_steps: Any, tolerance: Any = TOLERANCE) -> Float[Array, "b l c"]:
  """Gauss-Newton step for latents z (B, L, C), of the given variances, towards residual_of(z) = 0.

  Latents of variance 0 and motions of residual 0 stay. num_steps: conjugate gradient steps.
  """
  residuals, pull = jax.vjp(residual_of, z)
  backward = lambda a: pull(a)[0]
  push = jax.linear_transpose(backward, residuals)  # layers with a gradient of their own (`nets.layers`) have no jvp
  spread, rows = jnp.sqrt(variance), lambda a: a[:, None, None]

  def body(i, state):
    """Iteration 0 computes the gradient, the others are conjugate gradient steps; one body compiles once."""
    u, rest, way, square, wanted = state
    first = i == 0
    moved = jax.tree.map(lambda a, b: jnp.where(first, a, b), residuals, push(spread * way)[0])
    image = spread * backward(moved)
    wanted = jnp.where(first, -image, wanted)
    image = image + tolerance ** 2 * way
    curve = _dot(way, image)
    length = jnp.where(first, 0.0, rows(square / jnp.where(curve > 0, curve, 1.0)))
    u, rest = u + length * way, jnp.where(first, wanted, rest - length * image)
    fresh = _dot(rest, rest)
    way = rest + jnp.where(first, 0.0, rows(fresh / jnp.where(square > 0, square, 1.0))) * way
    return u, rest, way, fresh, wanted

  zero = jnp.zeros_like(z)
  u, *_, wanted = jax.lax.fori_loop(0, num_steps + 1, body, (zero, zero, zero, _dot(zero, zero), zero))
  # If a full step increases the residual, take the minimum of the parabola through both ends.
  step, slope, before = spread * u, -2 * _dot(wanted, u), _dot(residuals, residuals)
  moved = residual_of(z + step)
  bend = _dot(moved, moved) - before - slope
  part = jnp.clip(-slope / jnp.where(bend > 0, 2 * bend, 1.0), 0.05, 1.0)
  return jnp.where(rows(_dot(moved, moved) > before), rows(part) * step, step)


def refine(residual_of: Callable[..., Any], z: Float[Array, "b l c"], variance: Float[Array, "#b l 1"],
            num_times: int = 3, num_steps: int = SETTLING) -> Float[Array, "b l c"]:
  """Finished latents z (B, L, C) after num_times Gauss-Newton steps towards the constraints.

  The steps are large and amplify rounding: a relative difference of 1e-6 in the latents is a centimetre after three.
  """
  return jax.lax.fori_loop(0, num_times, lambda _, z: z + newton_step(residual_of, z, variance, num_steps,
                                                                      TOLERANCE / 2), z)
