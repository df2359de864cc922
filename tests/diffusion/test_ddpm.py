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
