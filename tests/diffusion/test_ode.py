"""The adaptive solver keeps its tolerance, counts its evaluations, and looks at the rows that it is told to."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion.ode import dopri5
from tests.diffusion.test_samplers import MEAN, STD, gaussian_velocity

# On Gaussian data the flow carries x to MEAN + STD x; numbers of all sizes, for tolerances are relative.
X = np.random.default_rng(0).normal(size=(6, 4)).astype(np.float32)


def velocity(x, t):
  return gaussian_velocity(x, jnp.broadcast_to(t, x.shape[:-1]))


@functools.partial(jax.jit, static_argnames=("rtol", "atol", "max_steps"))
def solve(x, rows=None, **tolerances):
  return dopri5(velocity, x, rows, **tolerances)


@pytest.mark.parametrize("rtol", [1e-2, 1e-5])
def test_the_flow_is_solved_to_its_tolerance(rtol):
  value, evaluations = solve(X, rtol=rtol, atol=1e-6)
  error = np.abs(value - (MEAN + STD * X)).max()
  assert error < 20 * rtol and (evaluations - 2) % 6 == 0  # the tolerance is each step's, the error all steps'
  assert evaluations > solve(X, rtol=10 * rtol, atol=1e-6).num_evaluations or rtol > 1e-3


def test_only_counted_rows_decide_the_steps():
  rows = jnp.array([True, True, False, True, False, False])
  value, evaluations = solve(X, rows)
  wild = solve(jnp.where(rows[:, None], X, 1e3 * X), rows)
  assert wild.num_evaluations == evaluations
  np.testing.assert_array_equal(wild.value[rows], value[rows])


def test_time_may_run_backward():
  """x' = t x from 0.5 to -1 and back."""
  run = jax.jit(lambda x, start, end: dopri5(lambda x, t: t * x, x, start=start, end=end).value, static_argnums=(1, 2))
  there = run(np.ones((2, 3), np.float32), 0.5, -1.0)
  np.testing.assert_allclose(there, np.exp((1 - 0.25) / 2), rtol=2e-2)
  np.testing.assert_allclose(run(there, -1.0, 0.5), 1, rtol=2e-2)


def test_what_does_not_arrive_is_nan():
  assert np.isnan(solve(X, max_steps=1, rtol=1e-6, atol=1e-9).value).all()
  assert np.isnan(jax.jit(lambda x: dopri5(lambda x, t: x / 0, x))(X).value).all()
