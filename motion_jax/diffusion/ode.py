"""Dormand and Prince's adaptive fifth-order ODE solver, with the step control of torchdiffeq 0.2.5.

diffrax and jax.experimental.ode have the same tableau, but other initial steps, step control and error norms; the
results of the reference depend on these by up to 1e-3. Source: docs/papers/cdamd.md#diffusion-mlp.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.shapes import Array, Bool, Float, Int

NODES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
# Fifth-order weights less Shampine's fourth-order ones, and weights of the value in the middle of a step.
ERROR = (35 / 384 - 1951 / 21600, 0.0, 500 / 1113 - 22642 / 50085, 125 / 192 - 451 / 720, -2187 / 6784 + 12231 / 42400,
         11 / 84 - 649 / 6300, -1 / 60)
MIDDLE = (6025192743 / 30085553152 / 2, 0.0, 51252292925 / 65400821598 / 2, -2691868925 / 45128329728 / 2,
          187940372067 / 1594534317056 / 2, -1776094331 / 19743644256 / 2, 11237099 / 235043384 / 2)
ORDER, SAFETY, FASTEST, SLOWEST = 5, 0.9, 10.0, 0.2


class Solution(NamedTuple):
  """The value at the end, and the number of velocity evaluations."""
  value: Float[Array, "*lead c"]
  num_evaluations: Int[Array, ""]


class _State(NamedTuple):
  x: jax.Array
  velocity: jax.Array     # at x
  start: jax.Array        # time at which the last step began
  time: jax.Array         # time of x
  step: jax.Array         # width of the next step
  curve: jax.Array        # coefficients of the last step's quartic
  num_evaluations: jax.Array


def dopri5(velocity: Callable, x: Float[Array, "*lead c"], rows: Bool[Array, "*lead"] | None = None,
           start: float = 0.0, end: float = 1.0, rtol: float = 1e-3, atol: float = 1e-6, max_steps: int = 10_000
           ) -> Solution:
  """Integrates dx/dt = velocity(x, t), t a scalar, from start to end, forward or backward in time.

  All rows share one step size, so a row's result depends slightly on the rest of the batch. rows (bool, x.shape[:-1]):
  only True rows count for the error estimate. Not differentiable in reverse mode. If max_steps steps do not reach the
  end, or the velocity is not finite, the value is NaN.
  """
  if end < start:  # in reversed time
    return dopri5(lambda x, t: -velocity(x, -t), x, rows, -start, -end, rtol, atol, max_steps)
  # In the reference times are float64 and values float32; without float64 here times are float32, which moves them by
  # about 1e-7 and matters only if a step ends within that of the last time.
  precise = jax.dtypes.canonicalize_dtype(np.float64)
  first, last = jnp.asarray(start, precise), jnp.asarray(end, precise)
  call = lambda x, t: velocity(x, t.astype(x.dtype)).astype(x.dtype)
  weight = jnp.ones(x.shape[:-1], x.dtype) if rows is None else rows.astype(x.dtype)
  total = jnp.maximum(weight.sum(), 1) * x.shape[-1]
  norm = lambda a: jnp.sqrt(jnp.where(weight[..., None] > 0, a * a, 0).sum() / total)
  mix = lambda weights, ks, width: sum(k * (w * width) for w, k in zip(weights, ks) if w)

  def first_step(x, v):
    """Hairer's initial step size, for order 4, that of the embedded method."""
    scale = atol + jnp.abs(x) * rtol
    size, slope = norm(x / scale), norm(v / scale)
    tiny = (size < 1e-5) | (slope < 1e-5)
    probe = jnp.where(tiny, 1e-6, 0.01 * size / jnp.where(tiny, 1, slope)).astype(x.dtype)
    bend = norm((call(x + probe * v, first + probe.astype(precise)) - v) / scale) / probe
    flat = (slope <= 1e-15) & (bend <= 1e-15)
    width = jnp.where(flat, jnp.maximum(1e-6, probe * 1e-3),
                      (0.01 / jnp.where(flat, 1, jnp.maximum(slope, bend))) ** (1 / ORDER))
    return jnp.minimum(100 * probe, width).astype(precise)

  def try_step(state):
    width = state.step.astype(x.dtype)
    time = state.time + state.step
    ks = [state.velocity]
    for node, weights in zip(NODES, STAGES):
      value = state.x + mix(weights, ks, width)
      at = time if node == 1 else state.time.astype(x.dtype) + node * width
      ks.append(call(value, at))
    allowed = atol + rtol * jnp.maximum(jnp.abs(state.x), jnp.abs(value))
    ratio = norm(mix(ERROR, ks, width) / allowed)
    curve = _quartic(state.x, value, state.x + mix(MIDDLE, ks, width), ks[0], ks[-1], width)
    pick = lambda new, old: jnp.where(ratio <= 1, new, old)
    return _State(pick(value, state.x), pick(ks[-1], state.velocity), pick(state.time, state.start),
                  pick(time, state.time), state.step * _step_factor(ratio, precise), pick(curve, state.curve),
                  state.num_evaluations + 6)

  def unfinished(state):
    return (state.time < last) & (state.num_evaluations < 2 + 6 * max_steps) & jnp.isfinite(state.step)

  v = call(x, first)
  state = _State(jnp.asarray(x), v, first, first, first_step(x, v), jnp.zeros((5,) + x.shape, x.dtype),
                 jnp.asarray(2, jnp.int32))
  state = jax.lax.while_loop(unfinished, try_step, state)
  place = ((last - state.start) / (state.time - state.start)).astype(x.dtype)
  value = sum(c * place ** i for i, c in enumerate(state.curve))
  return Solution(jnp.where(state.time < last, jnp.nan, value), state.num_evaluations)


def _step_factor(ratio: Float[Array, ""], precise: Any) -> Float[Array, ""]:
  """The factor by which the next step is longer, by the ratio of the error to the allowed one."""
  exact = ratio == 0
  factor = SAFETY / jnp.where(exact, 1, ratio).astype(precise) ** (1 / ORDER)
  return jnp.where(exact, FASTEST, jnp.clip(factor, jnp.where(ratio < 1, 1.0, SLOWEST), FASTEST))


def _quartic(x0: Float[Array, "*dims"], x1: Float[Array, "*dims"], middle: Float[Array, "*dims"],
             v0: Float[Array, "*dims"], v1: Float[Array, "*dims"], width: Float[Array, ""]) -> Float[Array, " 5 *dims"]:
  """Coefficients (5, ...) of the quartic through three values with the slopes at both ends; constant one first."""
  a = 2 * width * (v1 - v0) - 8 * (x1 + x0) + 16 * middle
  b = width * (5 * v0 - 3 * v1) + 18 * x0 + 14 * x1 - 32 * middle
  c = width * (v1 - 4 * v0) - 11 * x0 - 5 * x1 + 16 * middle
  return jnp.stack([x0, width * v0, c, b, a])
