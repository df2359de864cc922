"""Solvers that carry noise along a table of times; the plain form, which the fast one is tested against.

Their steps are given beforehand, so a row never feels its batch-mates; `ode.dopri5` chooses its own.
"""
from collections.abc import Callable

import jax
from jaxtyping import Float

from motion_jax.shapes import Array

Velocity = Callable[[jax.Array, jax.Array], jax.Array]  # of x (B, L, C) at times (L,) -> (B, L, C)


def euler(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Carries noise x (B, L, C) to data along times (N + 1, L), rising in N; velocity(x, t (L,)) -> (B, L, C)."""

  # Parity: the paper's algorithm 2 draws fresh noise in every step; the code, and we, take plain Euler steps.
  def step(x, interval):
    t, t_next = interval
    return x + (t_next - t)[:, None] * velocity(x, t), None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


def heun(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Like `euler`, with the mean of the velocities at both ends of a step: second order, two evaluations a step."""

  def step(x, interval):
    t, t_next = interval
    width = (t_next - t)[:, None]
    first = velocity(x, t)
    return x + width * (first + velocity(x + width * first, t_next)) / 2, None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


def midpoint(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Like `euler`, with the velocity in the middle of a step: second order, two evaluations a step."""

  def step(x, interval):
    t, t_next = interval
    width = (t_next - t)[:, None]
    middle = x + width / 2 * velocity(x, t)
    return x + width * velocity(middle, (t + t_next) / 2), None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


def rk4(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Kutta's 3/8 rule: fourth order, four evaluations a step."""
  # Parity: this one, not the classical rule, is what torchdiffeq calls rk4.

  def step(x, interval):
    t, t_next = interval
    width = (t_next - t)[:, None]
    k1 = velocity(x, t)
    k2 = velocity(x + width * k1 / 3, t + (t_next - t) / 3)
    k3 = velocity(x + width * (k2 - k1 / 3), t + (t_next - t) * 2 / 3)
    k4 = velocity(x + width * (k1 - k2 + k3), t_next)
    return x + width * (k1 + 3 * (k2 + k3) + k4) / 8, None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


SOLVERS = {"euler": euler, "heun": heun}  # those that frame-wise sampling knows too
FIXED_STEP = SOLVERS | {"midpoint": midpoint, "rk4": rk4}
