"""train.dtype=bfloat16 in every stage: networks compute in it, losses and parameters are float32."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.nets.post_norm import sinusoids
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics
from motion_jax.training.stage import DEVICES
from motion_jax.utils import config_files
from tests.conftest import light_training, load_config, some_of

NAMES = [name for name in config_files.names() if "/" not in name]
QUICK, SLOW = ("cdamd_length", "evaluator_movement"), ("cmdm_tokenizer", "cmdm_denoiser", "cdamd_generator")
pytestmark = pytest.mark.usefixtures("kept_features")


def _config(name, dtype="bfloat16"):
  config = load_config(name, "tiny").unlock()
  config.train.dtype = dtype
  return config.lock()


@pytest.mark.parametrize("name", some_of(NAMES, quick=QUICK, slow=SLOW))
def test_every_stage_computes_in_bfloat16_and_loses_in_float32(name):
  """Traced, not compiled: bfloat16 products are there, and what comes out are float32 sums."""
  config, _ = fit.resolve(_config(name))
  stage, next_batch, frozen, *_ = fit.setups()[config.stage](config)
  batch, rng = jax.device_put(next_batch(0)), jax.random.key(0)
  made = [jax.eval_shape(init, batch, rng) for init in (stage.init, stage.init_extra) if init is not None]
  assert {leaf.dtype for leaf in jax.tree.leaves(made[0])} <= {jnp.dtype("float32")}
  loss = lambda params, *extra: stage.loss(params, frozen, batch, 0, rng, *extra)[0]
  mapped = jax.vmap(loss, None, axis_size=1, axis_name=DEVICES)
  assert {leaf.dtype for leaf in jax.tree.leaves(jax.eval_shape(mapped, *made))} == {jnp.dtype("float32")}
  text = str(jax.make_jaxpr(mapped)(*made))
  assert "bf16" in text and ("dot_general" in text or "conv_general" in text)


@pytest.mark.parametrize("name", some_of(NAMES, slow=["cmdm_denoiser"]))
def test_two_steps_in_bfloat16_are_near_those_in_float32(name, tmp_path):
  losses = []
  for dtype in ("float32", "bfloat16"):
    with light_training(judged=True):
      fit.run(_config(name, dtype), tmp_path / dtype)
    losses.append([row["loss"] for row in read_metrics(tmp_path / dtype) if "loss" in row])
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(checkpoint.load_params(tmp_path / dtype)))
  np.testing.assert_allclose(losses[1], losses[0], rtol=0.1, atol=0.05)


def test_positions_are_counted_in_float32():
  """In bfloat16 frames past 256 would share their positions."""
  np.testing.assert_array_equal(sinusoids(400, 8, jnp.bfloat16), sinusoids(400, 8).astype(jnp.bfloat16))
