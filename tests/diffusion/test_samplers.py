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


@pytest.mark.parametrize("solver, order", [("euler", 1), ("heun", 2)])
def test_order_along_a_staircase_of_times(solver, order):
  """The flow carries x0 to MEAN + STD x0, since x_t = t MEAN + sqrt(t^2 STD^2 + (1 - t)^2) x0."""
  with jax.enable_x64(True):
    x0 = np.random.default_rng(0).normal(size=(3, 5, 4))
    run = jax.jit(lambda times: SOLVERS[solver](gaussian_velocity, jnp.asarray(x0), times))
    coarse, fine = (np.abs(run(staircase(n, 5, 2).astype(float)) - (MEAN + STD * x0)).max() for n in (40, 80))
  assert abs(coarse / fine - 2 ** order) < 0.25 * 2 ** order and fine < {1: 3e-2, 2: 1e-3}[order]


@pytest.mark.parametrize("solver, order", [("euler", 1), ("heun", 2), ("midpoint", 2), ("rk4", 4)])
def test_order_on_a_growing_flow(solver, order):
  """x' = (1 + t) x, x(1) = x(0) exp(3 / 2): no symmetry, which on Gaussian data lends midpoint a third order."""
  x0 = np.array([[[0.3, -1.0]]])
  with jax.enable_x64(True):
    run = jax.jit(lambda method, n: runge_kutta(lambda x, t: (1 + t) * x, jnp.asarray(x0), method, n))
    coarse, fine = (np.abs(run(METHODS[solver], n) - x0 * np.exp(1.5)).max() for n in (40, 80))
  assert abs(coarse / fine - 2 ** order) < 0.1 * 2 ** order


def test_euler_goes_by_where_a_step_begins_and_a_waiting_latent_does_not_move():
  """x' = t in two steps: 0.5 * 0 + 0.5 * 0.5, where the ends of the steps would give 0.75 at the same order."""
  run = jax.jit(lambda x, times: euler(lambda x, t: jnp.broadcast_to(t[:, None], x.shape), x, times))
  made = run(jnp.zeros((1, 3, 2)), np.array([[0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]]))
  np.testing.assert_allclose(made[0, :, 0], [0.25, 0, 0], rtol=1e-6)


@pytest.mark.parametrize("solver", ["euler", "heun"])
def test_equal_steps_are_a_table_of_times(solver):
  """The same numbers as by a table, whatever is computed together of the times."""
  x0 = np.random.default_rng(0).normal(size=(2, 3, 4)).astype(np.float32)
  table = jax.jit(SOLVERS[solver], static_argnums=0)(gaussian_velocity, x0, np.linspace(0, 1, 6)[:, None])
  for together in (1, 3):
    made = jax.jit(lambda x0, together=together: runge_kutta(
        lambda x, t: gaussian_velocity(x, t[None]), x0, METHODS[solver], 5, together=together))(x0)
    np.testing.assert_allclose(made, table, rtol=0, atol=2e-6)


@pytest.mark.parametrize("solver", ["euler", "heun"])
def test_half_precision_stays_half(solver):
  run = jax.jit(lambda x, times: SOLVERS[solver](lambda x, t: -x, x, times))
  assert run(jnp.ones((1, 2, 3), jnp.bfloat16), np.linspace(0, 1, 4, dtype=np.float32)[:, None]).dtype == jnp.bfloat16


def test_guidance():
  """Scale 1 is the model itself, 0 the one without words, 3 goes beyond (docs/papers/cmdm.md#guidance)."""
  with_text, without = np.array([[1.0, 2.0]]), np.array([[0.5, -1.0]])
  np.testing.assert_array_equal(guidance.combine(with_text, without, 1.0), with_text)
  np.testing.assert_array_equal(guidance.combine(with_text, without, 0.0), without)
  np.testing.assert_array_equal(guidance.combine(with_text, without, 3.0), without + 3 * (with_text - without))
  velocity = lambda x, t, drop: jnp.where(drop[:, None, None], -x, x) * t[:, None]
  x, t = jnp.ones((2, 3, 1)), jnp.array([0.1, 0.5, 1.0])
  np.testing.assert_allclose(jax.jit(guidance.guided(velocity, 3.0))(x, t)[..., 0], 5 * np.stack([t, t]), rtol=1e-6)
