"""Programs that run briefly are compiled quickly, and compute the same."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.training.compiling import Step


@pytest.mark.parametrize("quick", [True, False])
def test_a_step_is_compiled_once_for_each_shape_of_a_batch(quick):
  traced = []

  def step(state, batch):
    traced.append(batch["x"].shape)
    return {"w": state["w"] + jnp.tanh(batch["x"]).sum(0)}, batch["x"].mean()

  compiled = Step(jax.jit(step, donate_argnums=0), quick)
  for rows in (2, 3, 2, 3):
    x = np.linspace(-1, 1, rows * 4, dtype=np.float32).reshape(rows, 4)
    state, mean = compiled({"w": jnp.ones(4)}, {"x": x})
    np.testing.assert_allclose(state["w"], 1 + np.tanh(x).sum(0), rtol=1e-5)
    np.testing.assert_allclose(mean, x.mean(), atol=1e-6)
  assert traced == [(2, 4), (3, 4)]
