"""The samplers are solvers: on Gaussian data, where the flow is known, Euler's error halves with the step."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import guidance
from motion_jax.diffusion.samplers import METHODS, SOLVERS, euler, runge_kutta
from motion_jax.diffusion.schedules import staircase

MEAN, STD = 0.7, 0.4


def gaussian_velocity(x, t):
  """E[x1 - eps | x_t] for x1 ~ N(MEAN, STD^2): closed form."""
  t = t[:, None]
  variance = t ** 2 * STD ** 2 + (1 - t) ** 2
  return MEAN + (t * STD ** 2 - (1 - t)) / variance * (x - t * MEAN)


def error(solver, num_steps, lag):
  """The flow carries x0 to MEAN + STD x0, since x_t = t MEAN + sqrt(t^2 STD^2 + (1 - t)^2) x0."""
  x0 = jax.random.normal(jax.random.key(0), (3, 5, 4), jnp.float64)
  times = jnp.asarray(staircase(num_steps, 5, lag), jnp.float64)
  return float(jnp.abs(SOLVERS[solver](gaussian_velocity, x0, times) - (MEAN + STD * x0)).max())


@pytest.mark.parametrize("solver, order", [("euler", 1), ("heun", 2)])
@pytest.mark.parametrize("lag", [0, 2, 7])
def test_order(solver, order, lag):
  with jax.enable_x64(True):
    coarse, middle, fine = (error(solver, n, lag) for n in (20, 40, 80))
  for ratio in (coarse / middle, middle / fine):
    assert abs(ratio - 2 ** order) < 0.25 * 2 ** order
  assert fine < {1: 3e-2, 2: 1e-3}[order]


@pytest.mark.parametrize("solver, order", [("euler", 1), ("heun", 2), ("midpoint", 2), ("rk4", 4)])
def test_order_on_a_growing_flow(solver, order):
  """x' = (1 + t) x, x(1) = x(0) exp(3 / 2): no symmetry, which on Gaussian data lends midpoint a third order."""
  x0 = np.array([[[0.3, -1.0]]])
  with jax.enable_x64(True):
    run = jax.jit(lambda method, n: runge_kutta(lambda x, t: (1 + t) * x, jnp.asarray(x0), method, n))
    errors = [float(jnp.abs(run(METHODS[solver], n) - x0 * np.exp(1.5)).max()) for n in (20, 40, 80)]
  for ratio in (errors[0] / errors[1], errors[1] / errors[2]):
    assert abs(ratio - 2 ** order) < 0.1 * 2 ** order


def test_euler_goes_by_where_a_step_begins():
  """x' = t in two steps: 0.5 * 0 + 0.5 * 0.5, where the ends of the steps would give 0.75 at the same order."""
  x = euler(lambda x, t: jnp.broadcast_to(t[:, None], x.shape), jnp.zeros((1, 1, 1)), jnp.array([[0.0], [0.5], [1.0]]))
  np.testing.assert_allclose(x, 0.25, rtol=1e-6)


@pytest.mark.parametrize("solver", ["euler", "heun"])
def test_equal_steps_are_a_table_of_times(solver):
  """The same numbers as by a table, whatever is computed together of the times."""
  x0 = jax.random.normal(jax.random.key(0), (2, 3, 4))
  table = SOLVERS[solver](gaussian_velocity, x0, jnp.linspace(0, 1, 6)[:, None])
  for together in (1, 3, 8):
    made = runge_kutta(lambda x, t: gaussian_velocity(x, t[None]), x0, METHODS[solver], 5, together=together)
    np.testing.assert_allclose(made, table, rtol=0, atol=2e-6)


def test_a_waiting_latent_does_not_move():
  times = jnp.asarray(staircase(4, 3, 4))
  x = euler(lambda x, t: jnp.ones_like(x), jnp.zeros((1, 3, 2)), times[:5])
  np.testing.assert_allclose(x[0, :, 0], [1, 0, 0], atol=1e-6)


def test_guidance():
  """Scale 1 is the model itself, 0 the one without words, 3 goes beyond (docs/papers/cmdm.md#guidance)."""
  with_text, without = jnp.array([[1.0, 2.0]]), jnp.array([[0.5, -1.0]])
  np.testing.assert_array_equal(guidance.combine(with_text, without, 1.0), with_text)
  np.testing.assert_array_equal(guidance.combine(with_text, without, 0.0), without)
  np.testing.assert_array_equal(guidance.combine(with_text, without, 3.0), without + 3 * (with_text - without))
  velocity = lambda x, t, drop: jnp.where(drop[:, None, None], -x, x) * t[:, None]
  x, t = jnp.ones((2, 3, 1)), jnp.array([0.1, 0.5, 1.0])
  np.testing.assert_allclose(guidance.guided(velocity, 3.0)(x, t)[:, :, 0], 5 * jnp.stack([t, t]), rtol=1e-6)
