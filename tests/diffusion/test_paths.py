"""The straight path: conversions undo one another, forcing draws one time per block, the loss counts real latents."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import paths


def arrays():
  keys = jax.random.split(jax.random.key(0), 3)
  x1, noise = (jax.random.normal(key, (2, 6, 4)) for key in keys[:2])
  return x1, noise, jax.random.uniform(keys[2], (2, 6), minval=0.05, maxval=0.95)


def test_conversions_undo_one_another():
  x1, noise, t = arrays()
  x, velocity = paths.add_noise(x1, noise, t), x1 - noise
  np.testing.assert_allclose(paths.velocity_to_x1(x, velocity, t), x1, atol=1e-5)
  np.testing.assert_allclose(paths.velocity_to_noise(x, velocity, t), noise, atol=1e-5)


def test_ends_of_the_path():
  x1, noise, t = arrays()
  np.testing.assert_array_equal(paths.add_noise(x1, noise, jnp.zeros_like(t)), noise)
  np.testing.assert_array_equal(paths.add_noise(x1, noise, jnp.ones_like(t)), x1)


@pytest.mark.parametrize("length, block, draws", [(12, 3, 4), (12, 1, 12), (11, 3, 4), (12, 0, 1)])
def test_forcing_times(length, block, draws):
  t = np.asarray(paths.forcing_times(jax.random.key(1), 5, length, block))
  assert t.shape == (5, length) and (t >= 0).all() and (t < 1).all()
  assert all(len(np.unique(row)) == draws for row in t) and len(np.unique(t)) == 5 * draws
  if block:
    np.testing.assert_array_equal(t, t[:, np.arange(length) // block * block])


def test_loss_counts_real_latents_only():
  """Sum over real latents of the mean over channels; two halves of a batch add up to the whole.

  Source: docs/papers/cmdm.md#denoiser-loss.
  """
  x1, noise, t = arrays()
  mask = jnp.arange(6) < jnp.array([[4], [6]])
  velocity = lambda x, t: x * t[..., None]
  sums, weight = paths.forcing_loss(velocity, x1, mask, t, noise)
  x = np.asarray(t)[..., None] * x1 + (1 - np.asarray(t)[..., None]) * noise
  error = ((x * np.asarray(t)[..., None] - (x1 - noise)) ** 2).mean(-1)
  np.testing.assert_allclose(sums["loss"], error[0, :4].sum() + error[1].sum(), rtol=1e-6)
  assert int(weight) == 10
  halves = [paths.forcing_loss(velocity, x1[i:i + 1], mask[i:i + 1], t[i:i + 1], noise[i:i + 1]) for i in range(2)]
  np.testing.assert_allclose(sum(half["loss"] for half, _ in halves), sums["loss"], rtol=1e-6)
  # Padding may hold anything, even what is not a number.
  broken, _ = paths.forcing_loss(velocity, x1.at[0, 4:].set(jnp.nan), mask, t, noise)
  np.testing.assert_array_equal(broken["loss"], sums["loss"])


def test_targets_weigh_times():
  """eps is off by t times the velocity's error, x1 by 1 - t times (the path is straight)."""
  x1, noise, t = arrays()
  mask = jnp.ones(t.shape, bool)
  velocity = lambda x, t: x1 - noise + 1.0
  loss = {target: float(paths.forcing_loss(velocity, x1, mask, t, noise, target)[0]["loss"])
          for target in paths.TARGETS}
  t = np.asarray(t, np.float64)
  for target, expected in (("velocity", t.size), ("eps", (t ** 2).sum()), ("x1", ((1 - t) ** 2).sum())):
    assert loss[target] == pytest.approx(expected, rel=1e-4)
