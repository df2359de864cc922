"""A step is the same whatever maps it, and whatever number of devices takes part."""
import jax
import numpy as np
import optax
import pytest

from motion_jax import fit
from motion_jax.training import mesh, optimizers, train_step
from tests import processes
from tests.conftest import devices_env, load_config, some_of
from tests.training.test_train import _next_batch, _stage

MAPS = [mesh.Pmap, mesh.Mesh]


def tiny(name, **sections):
  """The config of two steps on batches of 8, {section: {field: value}} changed."""
  config = load_config(name, "tiny").copy_and_resolve_references().unlock()
  config.data.batch_size = 8
  for section, fields in sections.items():
    config[section].update(fields)
  return config.lock()


# What crosses devices inside of a loss: micro-batches of 4, and with a teacher the pairs of a set and the adaptive
# weight of alignment; codebooks.
CONFIGS = {
    "tokenizer": lambda: tiny("cmdm_tokenizer", frozen=dict(teacher=""), loss=dict(micro_batch=4),
                              optimizer=dict(skip_loss=1e6)),
    "aligned": lambda: tiny("cmdm_tokenizer", loss=dict(micro_batch=4, distance_pairs="set", kl_ramp=0)),
    "rvq": lambda: tiny("cdamd_rvq"),
}


def steps(config, where, count=2):
  """(state, losses) on the host after some steps of what a config trains."""
  config, _ = fit.resolve(config)
  stage, next_batch, frozen, *_ = fit.setups()[config.stage](config)
  tx = optimizers.make_optimizer(config.optimizer, 10)
  init = lambda batch, rng: train_step.init_state(stage, tx, batch, rng, config.optimizer.ema_decay > 0)
  state = where.init(init, next_batch(0), jax.random.key(0))
  step = where.compiled(train_step.make_train_step(stage, tx, config.optimizer.ema_decay, config.optimizer.skip_loss,
                                                   accumulate_steps=config.optimizer.accumulate_steps))
  frozen, losses = where.put(frozen or {}), []
  for number in range(count):
    state, metrics = step(state, frozen, where.rows(next_batch(number)), jax.random.key(1))
    losses.append(jax.tree.map(float, metrics))
  return jax.tree.map(np.asarray, state), losses


def run(name, folder):
  """Writes DEVICES.npz, with several devices after the two maps gave the same bytes of states and metrics."""
  (state, losses), *others = [steps(CONFIGS[name](), where()) for where in MAPS[:jax.device_count()]]
  other, theirs = others[0] if others else (state, losses)
  differ = [jax.tree_util.keystr(path) for (path, a), b in zip(jax.tree.leaves_with_path(state), jax.tree.leaves(other),
                                                               strict=True) if a.tobytes() != b.tobytes()]
  assert not differ and losses == theirs, (name, differ, losses, theirs)
  np.savez(f"{folder}/{jax.device_count()}.npz", *jax.tree.leaves((state.params, losses)))


@pytest.mark.parametrize("name", some_of(CONFIGS, slow=["tokenizer"]))
def test_pmap_and_a_mesh_give_the_same_bytes_and_devices_the_same_numbers(tmp_path, name):
  """Bytes are compared inside of `run`; sums over more devices are added in another order."""
  code = f"from tests.training import test_train_step; test_train_step.run({name!r}, {str(tmp_path)!r})"
  counts = (1, 4)
  said = [tmp_path / f"{count}.txt" for count in counts]
  started = [processes.Process(["-c", code], devices_env(count), file, file) for count, file in zip(counts, said)]
  for process, file in zip(started, said):
    assert process.wait() == 0, file.read_text()[-3000:]
  one, several = (np.load(tmp_path / f"{count}.npz").values() for count in counts)
  for a, b in zip(one, several, strict=True):
    np.testing.assert_allclose(a, b, rtol=2e-4, atol=2e-5)


@pytest.mark.slow
def test_a_batch_in_parts_is_the_whole_batch():
  """Noise and dropout: losses and parameters agree up to rounding."""
  found = [steps(tiny("cmdm_denoiser", optimizer=dict(accumulate_steps=parts)), mesh.Pmap()) for parts in (1, 4)]
  (state, losses), (other, theirs) = found
  for one, two in zip(*(jax.tree.leaves((state.params, losses)) for state, losses in found), strict=True):
    np.testing.assert_allclose(one, two, rtol=2e-3, atol=2e-5)
  assert int(state.step) == int(other.step) == len(losses) == len(theirs)


def test_a_loss_with_a_weight_for_each_row_is_refused():
  """It would divide every gradient by every row's weight."""
  line, where, batch, tx = _stage(), mesh.Pmap(), _next_batch(0), optax.sgd(0.1)
  stage = line._replace(loss=lambda params, frozen, batch, *rest: (
      line.loss(params, frozen, batch, *rest)[0], batch["mask"]))
  state = where.init(lambda *args: train_step.init_state(stage, tx, *args), batch, jax.random.key(0))
  with pytest.raises(ValueError, match="input 0 has shape .* but expected .*'weight': a stage's loss returns sums"):
    where.compiled(train_step.make_train_step(stage, tx, 0.9))(state, {}, where.rows(batch), jax.random.key(1))
