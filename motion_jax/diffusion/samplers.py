"""Solvers that carry noise along a table of times; the plain form, which the fast one is tested against."""
import jax


def euler(velocity, x, times):
  """Carries noise x (B, L, C) to data along times (N + 1, L), rising in N; velocity(x, t (L,)) -> (B, L, C)."""

  # Parity: the paper's algorithm 2 draws fresh noise in every step; the code, and we, take plain Euler steps.
  def step(x, interval):
    t, t_next = interval
    return x + (t_next - t)[:, None] * velocity(x, t), None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


def heun(velocity, x, times):
  """Like `euler`, with the mean of the velocities at both ends of a step: second order, two evaluations a step."""

  def step(x, interval):
    t, t_next = interval
    width = (t_next - t)[:, None]
    first = velocity(x, t)
    return x + width * (first + velocity(x + width * first, t_next)) / 2, None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


SOLVERS = {"euler": euler, "heun": heun}
