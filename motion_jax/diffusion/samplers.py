"""ODE solvers with fixed steps, in which batch items are independent; `ode.dopri5` has adaptive steps.

`euler` and `heun` follow a table of times, one per latent: the simple form, against which cached sampling is tested.
`runge_kutta` takes equal steps of any method of `METHODS`.
"""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.shapes import Array, Float

Velocity = Callable[[jax.Array, jax.Array], jax.Array]  # of x (B, L, C) at times (L,) -> (B, L, C)


def euler(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Samples data from noise x (B, L, C) along times (N + 1, L), ascending in N; velocity(x, t (L,)) -> (B, L, C)."""

  # Parity: the paper's algorithm 2 draws fresh noise in every step; the code, and we, take plain Euler steps.
  def step(x, interval):
    t, t_next = interval
    return (x + (t_next - t)[:, None] * velocity(x, t)).astype(x.dtype), None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


def heun(velocity: Velocity, x: Float[Array, "*lead c"], times: Float[Array, " n #l"]) -> Float[Array, "*lead c"]:
  """Like `euler`, with the mean of the velocities at both ends of a step: second order, two evaluations a step."""

  def step(x, interval):
    t, t_next = interval
    width = (t_next - t)[:, None]
    first = velocity(x, t)
    return (x + width * (first + velocity((x + width * first).astype(x.dtype), t_next)) / 2).astype(x.dtype), None

  return jax.lax.scan(step, x, (times[:-1], times[1:]))[0]


SOLVERS = {"euler": euler, "heun": heun}  # the solvers of frame-wise sampling


class Method(NamedTuple):
  """Butcher tableau of an explicit Runge-Kutta method of up to 4 evaluations per step.

  As arrays, all methods share one compiled program. nodes (4,): time of each evaluation within the step; stages (4, 4):
  weights of earlier velocities at each; weights (4,): of all velocities in the step; count: number of evaluations.
  """
  nodes: Float[Array, "4"]
  stages: Float[Array, "4 4"]
  weights: Float[Array, "4"]
  count: Any


def _method(nodes: Sequence[float], stages: Sequence[Sequence[float]], weights: Sequence[float]) -> Method:
  table = np.zeros((4, 4), np.float64)
  for i, row in enumerate(stages):
    table[i + 1, :len(row)] = row
  pad = lambda row: np.pad(np.array(row, np.float64), (0, 4 - len(row)))
  return Method(pad(nodes), table, pad(weights), np.int32(len(nodes)))


METHODS = {
    "euler": _method([0], [], [1]),
    "heun": _method([0, 1], [[1]], [1 / 2, 1 / 2]),
    "midpoint": _method([0, 1 / 2], [[1 / 2]], [0, 1]),
    # Parity: Kutta's 3/8 rule, not the classical one, is what torchdiffeq calls rk4.
    "rk4": _method([0, 1 / 3, 2 / 3, 1], [[1 / 3], [-1 / 3, 1], [1, -1, 1]], [1 / 8, 3 / 8, 3 / 8, 1 / 8]),
}


def runge_kutta(velocity: Callable[..., Array], x: Float[Array, "*lead c"], method: Method, num_steps: Any,
                prepare: Callable[[Float[Array, " n"]], Any] = lambda times: times, together: int = 4
                ) -> Float[Array, "*lead c"]:
  """Integrates x from t = 0 to 1 in num_steps equal steps of a method; both may be traced.

  velocity(x, ready), where ready is one row of prepare(times (N,)): prepare computes what depends on the time alone,
  for up to `together` evaluations at once.
  """
  if not any(isinstance(count, jax.Array) for count in (num_steps, method.count)):
    known = int(num_steps) * int(method.count)
    together = max(n for n in range(1, together + 1) if known % n == 0)  # so that both loops have known lengths
  else:
    known = None
  method = jax.tree.map(lambda a: jnp.asarray(a, None if a.dtype.kind == "i" else x.dtype), method)
  num_steps = jnp.asarray(num_steps, jnp.int32)
  width, total = 1 / num_steps.astype(x.dtype), num_steps * method.count
  mix = lambda weights, slopes: width * jnp.tensordot(weights, slopes, 1)

  def chunk(i, state):
    index = i * together + jnp.arange(together)
    step, stage = index // method.count, index % method.count
    ready = prepare((step + method.nodes[stage]) * width)

    def evaluate(j, state):
      x, slopes = state
      here = jnp.take(stage, j)
      slope = velocity(x + mix(method.stages[here], slopes), jax.tree.map(lambda a: a[j], ready))
      slopes = slopes.at[here].set(slope)
      return jnp.where(here == method.count - 1, x + mix(method.weights, slopes), x), slopes

    return jax.lax.fori_loop(0, together if known else jnp.minimum(together, total - i * together), evaluate, state)

  chunks = known // together if known else (total + together - 1) // together
  return jax.lax.fori_loop(0, chunks, chunk, (x, jnp.zeros((4, *x.shape), x.dtype)))[0]
