"""Negative-aware fine-tuning: optimality by hand, and the loss against its closed form."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import negative_aware
from motion_jax.utils.errors import InputError


def test_optimality_of_a_group():
  rewards, groups = np.array([0.0, 1.0, 0.5, 0.5, 1.0, 0.0]), np.array([0, 0, 1, 1, 2, 2])
  r = negative_aware.optimality(rewards, groups, 2.0)
  half = 0.5 / (rewards.std() + 1e-4) / 4
  np.testing.assert_allclose(r, [0.5 - half, 0.5 + half, np.nan, np.nan, 0.5 + half, 0.5 - half])
  assert negative_aware.optimality(np.array([0, 1e3, 0, 0, 0, 0, 0]), np.array([0, 0, 1, 1, 1, 1, 1]), 0.1)[1] == 1
  with pytest.raises(InputError, match="got 4 rewards that do not differ within any of 2 groups"):
    negative_aware.optimality(np.ones(4), np.array([0, 0, 1, 1]))


@pytest.mark.parametrize("beta", [1.0, 0.1])
def test_closed_form(beta):
  """In one number per sample all errors are |x + (1 - t) v - x1|: (off)^2 / |off|."""
  t, x, clean, old, v, ref = 0.25, 0.4, 1.0, 0.2, 0.5, 0.1
  full = lambda value: jnp.full((2, 3, 1), value)
  r = jnp.array([0.9, 0.2])
  mask = jnp.array([[True, True, False]] * 2)
  run = lambda v: negative_aware.loss(v, full(old), full(ref), full(x), full(clean), jnp.full((2, 3), t), mask, r, beta,
                                      5.0, 1e-2)
  plus = abs(x + (1 - t) * (beta * v + (1 - beta) * old) - clean)
  minus = abs(x + (1 - t) * ((1 + beta) * old - beta * v) - clean)
  expected = [5.0 / beta * (r_ * plus + (1 - r_) * minus) + 1e-2 * (v - ref) ** 2 for r_ in (0.9, 0.2)]
  np.testing.assert_allclose(run(full(v)), expected, rtol=1e-5)
  # The gradient in v of off^2 / |off|, the divisor held: 2 sign(off) times that of off.
  gradient = jax.grad(lambda v: run(v).sum())(full(v))
  slope = [5.0 * 2 * (1 - t) * (-r_ + (1 - r_)) / 2 + 1e-2 * (v - ref) for r_ in (0.9, 0.2)]  # off < 0 in both
  np.testing.assert_allclose(gradient[:, 0, 0], slope, rtol=1e-4)
  assert (gradient[:, 2] == 0).all()


def test_a_network_that_equals_the_old_one_goes_towards_what_is_better_than_average():
  x1 = jax.random.normal(jax.random.key(0), (2, 4, 3))
  noise, t = jax.random.normal(jax.random.key(1), x1.shape), jnp.full((2, 4), 0.5)
  x, old = 0.5 * x1 + 0.5 * noise, jnp.zeros_like(x1)
  step = lambda r: -jax.grad(lambda v: negative_aware.loss(
      v, old, old, x, x1, t, jnp.ones((2, 4), bool), jnp.array([r, r])).sum())(old)
  towards = lambda r: float((step(r) * (x1 - noise - old)).sum())
  assert towards(1.0) > 0 > towards(0.0) and towards(0.5) == pytest.approx(0, abs=1e-4)
