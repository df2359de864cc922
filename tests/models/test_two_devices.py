"""A training step of each further method is the same on two devices, whose halves of a batch differ in real frames."""
import flax
import jax
import numpy as np
import optax
import pytest

from motion_jax import fit
from motion_jax.training import mesh, train_step
from tests import processes
from tests.conftest import devices_env, light_setups, load_config

CONFIGS = ("mdm_denoiser", "mld_denoiser", "momask_masked", "momask_rvq", "t2m_gpt_gpt", "motionstreamer_generator")


def first_step(name) -> dict[str, np.ndarray]:
  """Metrics, codebooks and gradients, which are the steps of plain descent with rate 1.

  Weights are random: some networks start with zeros that keep gradients from all layers below. Not Adam: where a
  gradient is nothing but rounding it steps by the sign of it, and such are those of every bias of attention's keys,
  which adds one number to all scores of a query and so nothing to their softmax.
  """
  config = load_config(name, "tiny").copy_and_resolve_references().unlock()
  config.data.batch_size = 8
  config, _ = fit.resolve(config.lock())
  plain, next_batch, frozen, *_ = light_setups()[config.stage](config)
  # Factors of scores, too, which are 0 otherwise.
  init = lambda *given: jax.tree.map(lambda leaf: leaf + np.float32(leaf.ndim == 0), plain.init(*given))
  where, batch, tx, stage = mesh.Pmap(), next_batch(0), optax.sgd(1.0), plain._replace(init=init)
  state = where.init(lambda *given: train_step.init_state(stage, tx, *given), batch, jax.random.key(0))
  before = jax.tree.map(np.asarray, state.params)
  step = where.compiled(train_step.make_train_step(stage, tx, 0.0))
  state, metrics = step(state, where.put(frozen or {}), where.rows(batch), jax.random.key(1))
  moved = jax.tree.map(lambda new, old: np.asarray(new) - old, state.params, before)
  parts = {"moved": moved, "metrics": metrics, "codebooks": jax.tree.map(np.asarray, state.extra or {})}
  return flax.traverse_util.flatten_dict({name: parts}, sep="/")


def write(folder, configs=CONFIGS):
  """Writes DEVICES.npz, the `first_step` of all."""
  found = {}
  for name in configs:
    found |= first_step(name)
  np.savez(f"{folder}/{jax.device_count()}.npz", **found)


@pytest.mark.exhaustive
def test_a_step_on_two_devices_is_the_step_on_one(tmp_path):
  code = f"from tests.models import test_two_devices; test_two_devices.write({str(tmp_path)!r})"
  for count in (1, 2):
    done = processes.run(["-c", code], devices_env(count))
    assert done.returncode == 0, done.stderr[-3000:]
  one, two = (np.load(tmp_path / f"{count}.npz") for count in (1, 2))
  assert set(one) == set(two)
  for name in one:
    np.testing.assert_allclose(two[name], one[name], rtol=1e-5, atol=1e-5, err_msg=name)
  still = [name for name in one if "/moved/" in name and not one[name].any()]
  assert [name.rpartition("/")[2] for name in still] == ["logit_scale"], still  # as released: read as a number
