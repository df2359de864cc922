"""DDPM's tables and steps: what is known in closed form comes out."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import ddpm

X1 = np.array([[0.5, -2.0, 1.0]], np.float32)  # data that is one point: its noise is known exactly


def known_noise(schedule):
  kept = jnp.asarray(schedule.alphas_cumprod, jnp.float32)

  def predict(x, step):
    left = kept[step]
    return (x - jnp.sqrt(left) * X1) / jnp.sqrt(1 - left)

  return predict


def test_the_schedule():
  """Measured on the reference (docs/papers/cdamd.md#diffusion-mlp)."""
  schedule = ddpm.cosine_schedule(50)
  np.testing.assert_allclose(schedule.betas[[0, 1, 24, 49]], [0.00174751, 0.00368895, 0.05935366, 0.999], atol=5e-9)
  np.testing.assert_allclose(schedule.alphas_cumprod[[0, 24]], [0.998252, 0.493844], atol=5e-7)
  assert (np.diff(schedule.alphas_cumprod) < 0).all() and schedule.posterior_variance[0] == 0


@pytest.mark.parametrize("num_steps", [50, 1])
def test_the_way_back_ends_at_the_data(num_steps):
  whole = ddpm.cosine_schedule(50)
  schedule = ddpm.respace(whole, num_steps)
  np.testing.assert_allclose(schedule.alphas_cumprod, whole.alphas_cumprod[schedule.steps], rtol=1e-12)
  assert len(schedule.betas) == num_steps and schedule.steps[0] == 0
  fresh = lambda m: jax.random.normal(jax.random.fold_in(jax.random.key(0), m), X1.shape)
  knows_data = lambda x, step: jnp.asarray(X1)
  for back in (lambda x: ddpm.ancestral(known_noise(whole), schedule, x, fresh),
               lambda x: ddpm.ddim(known_noise(whole), schedule, x),
               lambda x: ddpm.ddim(knows_data, schedule, x, predicts="x1")):
    np.testing.assert_allclose(jax.jit(back)(np.ones_like(X1)), X1, atol=1e-4)


def test_all_steps_are_the_schedule_itself():
  whole = ddpm.cosine_schedule(50)
  for ours, theirs in zip(ddpm.respace(whole, 50), whole):
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)
  with pytest.raises(ValueError, match="51 sampler steps.*50 of training"):
    ddpm.respace(whole, 51)


def test_the_loss_of_a_perfect_prediction_is_zero():
  schedule, noise = ddpm.cosine_schedule(50), np.ones((1, 3), np.float32)
  rows = jax.jit(lambda step: ddpm.loss_rows(known_noise(schedule), schedule, X1, step, noise)[0])
  np.testing.assert_allclose([rows(np.array([step])) for step in (0, 9, 30, 48)], 0, atol=1e-6)
