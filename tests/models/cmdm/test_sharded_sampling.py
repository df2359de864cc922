"""A denoiser whose parameters are sharded over the model axis makes the motion of one device."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models.cmdm import streaming
from motion_jax.nets.partitioning import LAYOUTS, axes_of, shardings
from tests import processes
from tests.conftest import devices_env
from tests.nets.test_causal_dit import init, inputs, small


def latents(dit, params):
  plan = streaming.make_plan(4, 2, 3, 12, 4)
  text = jax.random.normal(jax.random.key(2), (2, 4, dit.text_dim))
  make = lambda params: streaming.bind(dit, plan, params, text_emb=text, text_mask=jnp.ones((2, 4), bool), scale=2.0,
                                       keys=jax.random.split(jax.random.key(1), 2)).sample(4)
  return np.asarray(jax.jit(make)(params))


def run():
  dit, params = small(width=32, num_heads=4)
  params = jax.tree.map(lambda leaf: 0.4 * leaf, params)  # latents near 1, as in a trained model
  one = latents(dit, params)
  axes = axes_of(lambda: init(dit, jax.random.key(0), *inputs()))
  for data, model, layout in ((2, 4, "tensor"), (4, 2, "fully_sharded")):
    mesh = jax.sharding.Mesh(np.reshape(jax.devices(), (data, model)), ("data", "model"))
    split = jax.device_put(params, shardings(axes, params, mesh, LAYOUTS[layout]))
    on_one = sum(leaf.addressable_shards[0].data.size for leaf in jax.tree.leaves(split))
    assert on_one < 2 * sum(leaf.size for leaf in jax.tree.leaves(params)) / model
    found = latents(dit, split)
    assert np.abs(one).max() > 0.1
    np.testing.assert_allclose(found, one, rtol=1e-5, atol=1e-5)
    print(layout, np.abs(found - one).max())


@pytest.mark.slow
def test_sharded_parameters_sample_the_same():
  code = "from tests.models.cmdm import test_sharded_sampling; test_sharded_sampling.run()"
  done = processes.run(["-c", code], devices_env(8))
  assert done.returncode == 0, done.stderr[-3000:]
