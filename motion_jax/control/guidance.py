"""Guide latents towards constraints: damped Gauss-Newton steps through a decoder and the joints that it makes.

Latents z have places J(z) that should be c. Taken as normal around z with variances P, and the places as known to a
tolerance s, their most likely change is d = P A' (A P A' + s^2)^-1 (c - J(z)), where A is the derivative of J: the
pseudo-inverse guidance of diffusion models (Song et al., ICLR 2023) with a decoder in between. A is never made; the
same d comes of a few conjugate gradient steps, each of which takes it forwards and backwards once, motion by motion.
"""
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from motion_jax.control.signal import ControlSignal
from motion_jax.shapes import Array, Float

TOLERANCE = 0.01  # metres
SETTLING = 6      # conjugate gradient steps of each Gauss-Newton step on finished latents
_TURN = 0.3       # metres that a radian of heading counts as


def residual(signal: ControlSignal, joints: Float[Array, "b t j 3"], heading: Float[Array, "b t"]
             ) -> tuple[Float[Array, "b t j 3"], Float[Array, "b t"]]:
  """Differences of joints (B, T, 22, 3) and headings (B, T) from a signal: 0 where nothing is given."""
  turn = jnp.sin(heading - signal.heading)  # of half a turn and more the sine is no way back
  turn = jnp.where(jnp.cos(heading - signal.heading) < 0, jnp.sign(turn), turn)
  return (jnp.where(signal.given, joints - signal.positions, 0.0),
          jnp.where(signal.heading_given, _TURN * turn, 0.0))


def _dot(a, b):
  """Of the rows of two trees with leaves (B, ...): (B,)."""
  return sum((x * y).reshape(x.shape[0], -1).sum(1) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b)))


def newton_step(residual_of: Callable[..., Any], z: Float[Array, "b l c"], variance: Float[Array, "#b l 1"],
                num_steps: Any, tolerance: Any = TOLERANCE) -> Float[Array, "b l c"]:
  """The step for latents z (B, L, C), of the given variances, that brings residual_of(z) near 0.

  A latent of variance 0 stays, and so does a motion whose residual is 0. num_steps: conjugate gradient steps.
  """
  found, pull = jax.vjp(residual_of, z)
  backward = lambda a: pull(a)[0]
  push = jax.linear_transpose(backward, found)  # layers with a gradient of their own (`nets.layers`) have no jvp
  spread, rows = jnp.sqrt(variance), lambda a: a[:, None, None]

  def body(i, state):
    """Round 0 finds the slope, those behind it are conjugate gradient steps: one body, so that all is compiled once."""
    u, rest, way, square, wanted = state
    first = i == 0
    moved = jax.tree.map(lambda a, b: jnp.where(first, a, b), found, push(spread * way)[0])
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
  # Where a whole step makes it worse, the lowest point of the parabola through both ends.
  step, slope, before = spread * u, -2 * _dot(wanted, u), _dot(found, found)
  moved = residual_of(z + step)
  bend = _dot(moved, moved) - before - slope
  part = jnp.clip(-slope / jnp.where(bend > 0, 2 * bend, 1.0), 0.05, 1.0)
  return jnp.where(rows(_dot(moved, moved) > before), rows(part) * step, step)


def refine(residual_of: Callable[..., Any], z: Float[Array, "b l c"], variance: Float[Array, "#b l 1"],
            num_times: int = 3, num_steps: int = SETTLING) -> Float[Array, "b l c"]:
  """Finished latents z (B, L, C) after num_times Gauss-Newton steps: as near to the constraints as they get.

  The steps are large, so rounding grows: latents that differ by 1e-6 of their size differ by a centimetre behind three.
  """
  return jax.lax.fori_loop(0, num_times, lambda _, z: z + newton_step(residual_of, z, variance, num_steps,
                                                                      TOLERANCE / 2), z)
