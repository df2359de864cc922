"""The loop: resuming is exact, devices do not matter, a broken run is told."""
import itertools
import resource
import shutil

import chex
import jax
import jax.numpy as jnp
import ml_collections
import numpy as np
import pytest

from configs import common
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import Stats, save_stats
from motion_jax.training import checkpoint, mesh, optimizers, prefetch, train_step
from motion_jax.training import loop as train
from motion_jax.training.metrics import append_metrics, read_metrics
from motion_jax.training.report import best_step
from motion_jax.training.saver import Saver, copy_of
from motion_jax.training.stage import Stage


def _stage():
  """A line through points with unequal weights per row: the smallest thing with padding."""

  def init(batch, rng):
    return {"w": jax.random.normal(rng, (3,))}

  def loss(params, frozen, batch, step, rng):
    noise = jax.vmap(lambda i: jax.random.normal(jax.random.fold_in(rng, i)))(batch["index"])
    error = batch["x"] @ params["w"] - batch["y"] + 0.01 * noise
    return {"loss": (batch["mask"] * error ** 2).sum()}, batch["mask"].sum()

  return Stage(init, loss, None, in_parts=True)


def _next_batch(step):
  rng = np.random.default_rng(step)
  x = rng.normal(size=(8, 3)).astype(np.float32)
  mask = (rng.random(8) < [0.2, 1, 1, 0.3, 1, 1, 1, 1]).astype(np.float32)
  return {"x": x, "y": x @ np.array([1.0, -2, 3], np.float32), "mask": mask, "index": np.arange(8)}


def _config(num_steps, **optimizer):
  config = ml_collections.ConfigDict()
  config.seed = 0
  config.mesh = common.mesh()
  config.optimizer = common.optimizer(**dict(learning_rate=1e-2, warmup_steps=1, beta2=0.99, clip_norm=1.0,
                                             ema_decay=0.9) | optimizer)
  config.train = common.train(num_steps, 1, 2)
  return config


def _equal(a, b):
  return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


@pytest.mark.slow
def test_a_batch_in_parts_is_one_step_and_goes_on_with_or_without(tmp_path):
  """Rows that count are spread unevenly over the parts; nothing is saved between two parts, so that any save goes on
  to the same bytes."""
  stage, rows = _stage(), []  # rows: how many the loss is given at once
  counted = stage._replace(loss=lambda *given: rows.append(len(given[2]["x"])) or stage.loss(*given))
  run = lambda steps, parts, folder, **options: train.train(
      _config(steps, accumulate_steps=parts), tmp_path / folder, counted, _next_batch, **options)
  whole, at_once, parts = run(6, 1, "whole"), set(rows), run(6, 4, "parts")
  assert int(parts.step) == 6 and at_once == {8} and set(rows) == {8, 2}
  np.testing.assert_allclose(whole.params["w"], parts.params["w"], rtol=1e-5)
  run(4, 4, "sliced")
  assert _equal(run(6, 4, "sliced", resume=True), parts)
  with pytest.raises(ValueError, match="8 rows on each device and optimizer.accumulate_steps = 3"):
    run(2, 3, "odd")
  config = _config(2, accumulate_steps=2)
  with pytest.raises(ValueError, match="accumulate_steps = 2, but the items of a batch interact"):
    train.train(config, tmp_path / "meeting", _stage()._replace(in_parts=False), _next_batch)


@pytest.mark.slow
def test_a_run_without_an_average_has_no_copy_and_goes_on_where_one_was_saved(tmp_path):
  """A run of a version that saved one with ema_decay 0 too."""
  config = _config(4, ema_decay=0.0)
  whole = train.train(config, tmp_path / "whole", _stage(), _next_batch)
  assert whole.ema_params is None and _equal(checkpoint.load_params(tmp_path / "whole"), whole.params)
  folder = tmp_path / "older"
  half = train.train(_config(2, ema_decay=0.0), folder, _stage(), _next_batch)
  shutil.rmtree(folder / "checkpoints")
  saver = Saver(folder)
  saver.save(2, copy_of(half.replace(ema_params=half.params)))
  saver.close()
  assert _equal(train.train(config, folder, _stage(), _next_batch, resume=True), whole)


def test_an_average_without_the_start_weighs_the_steps_alone():
  """After n steps sum of decay ** (n - k) * parameters of step k, over the sum of the weights."""
  stage, decay = _stage(), 0.9999
  tx = optimizers.make_optimizer(_config(4).optimizer, 4)
  state = train_step.init_state(stage, tx, _next_batch(0), jax.random.key(0))
  pmap = mesh.Pmap()
  step = pmap.compiled(train_step.make_train_step(stage, tx, decay, ema_debias=True))
  made = []
  for number in range(4):
    state, _ = step(state, {}, pmap.rows(_next_batch(number)), jax.random.key(1))
    made.append(np.asarray(state.params["w"]))
    weights = decay ** np.arange(number, -1, -1)
    np.testing.assert_allclose(state.ema_params["w"], weights @ np.stack(made) / weights.sum(), rtol=1e-5)


@pytest.mark.parametrize("decay", [0.9, 0.0])
def test_the_average_keeps_its_decay_of_what_was(decay):
  """After one step decay * start + (1 - decay) * new; a decay of 0.9 exchanged with its rest would follow the last."""
  stage, batch = _stage(), _next_batch(0)
  tx = optimizers.make_optimizer(_config(4).optimizer, 4)
  state = train_step.init_state(stage, tx, batch, jax.random.key(0))
  start = np.asarray(state.params["w"])
  pmap = mesh.Pmap()
  step = pmap.compiled(train_step.make_train_step(stage, tx, decay))
  state, _ = step(state, {}, pmap.rows(batch), jax.random.key(1))
  once = np.asarray(state.params["w"])
  assert np.abs(once - start).min() > 1e-3
  np.testing.assert_allclose(state.ema_params["w"], decay * start + (1 - decay) * once, rtol=1e-5)
  average = np.asarray(state.ema_params["w"])
  state, _ = step(state, {}, pmap.rows(_next_batch(1)), jax.random.key(1))
  np.testing.assert_allclose(state.ema_params["w"], decay * average + (1 - decay) * np.asarray(state.params["w"]),
                             rtol=1e-5)


def test_every_step_has_noise_of_its_own():
  """The same batch, weights and key: only the step's number differs, and with it what is drawn."""
  stage, batch = _stage(), _next_batch(0)
  tx = optimizers.make_optimizer(_config(4, learning_rate=0.0).optimizer, 4)
  state = train_step.init_state(stage, tx, batch, jax.random.key(0))
  pmap = mesh.Pmap()
  step, losses = pmap.compiled(train_step.make_train_step(stage, tx, 0.0)), []
  for _ in range(3):
    state, metrics = step(state, {}, pmap.rows(batch), jax.random.key(1))
    losses.append(float(metrics["loss"]))
  assert len(set(losses)) == 3 and np.ptp(losses) < 0.1 * losses[0]


def test_the_best_is_the_smallest_or_the_largest(tmp_path):
  for step, error in ((2, 3.0), (4, 1.0), (6, 2.0)):
    append_metrics(tmp_path, {"step": step, "error": error})
  config = _config(6)
  for best, steps in (("", [2, 4, 6]), ("min error", [2, 4]), ("max error", [2]), ("min missing|error", [2, 4])):
    config.train.best = best
    assert [step for step in (2, 4, 6) if best_step(config, tmp_path, step, True) == step] == steps, best
  config.train.best = "min missing"
  with pytest.raises(ValueError, match="'missing', which the evaluation at step 4 did not give"):
    best_step(config, tmp_path, 4, True)


def test_parameters_come_back_as_they_were_whatever_lies_in_memory(tmp_path):
  """A transposed view and a cut one: a file that takes their bytes as they lie would hold other numbers."""
  whole = np.arange(12, dtype=np.float32).reshape(3, 4)
  half = whole.astype(np.float16)
  checkpoint.save_params(tmp_path, {"params": {"turned": whole.T, "cut": whole[:, 1:3], "half": half}})
  loaded = checkpoint.load_params(tmp_path)["params"]
  np.testing.assert_array_equal(loaded["turned"], whole.T)
  np.testing.assert_array_equal(loaded["cut"], whole[:, 1:3])
  np.testing.assert_array_equal(loaded["half"], whole)


def test_a_run_is_neither_overwritten_nor_resumed_from_nothing(tmp_path):
  train.train(_config(2), tmp_path, _stage(), _next_batch)
  with pytest.raises(ValueError, match="--resume"):
    train.train(_config(2), tmp_path, _stage(), _next_batch)
  shutil.rmtree(tmp_path / "checkpoints")
  shutil.move(tmp_path, tmp_path.with_name("other"))
  with pytest.raises(FileNotFoundError, match="no checkpoint"):
    train.train(_config(2), tmp_path.with_name("other"), _stage(), _next_batch, resume=True)


def test_what_is_no_number_is_never_saved(tmp_path):
  """Off the log grid too, at a broken gradient under a sound loss, and when the run is asked to stop."""
  bad = lambda step: _next_batch(step) | {"y": np.full(8, np.nan if step == 2 else 0.0, np.float32)}
  config = _config(8)
  config.train.log_every, config.train.save_every = 8, 1
  with pytest.raises(FloatingPointError, match="last good state is step 2"):
    train.train(config, tmp_path / "loss", _stage(), bad)
  assert Saver(tmp_path / "loss").latest == 2
  assert np.isfinite(checkpoint.load_params(tmp_path / "loss")["w"]).all()

  def loss(params, frozen, batch, step, rng):  # at the third step the gradient alone is no number
    root = jnp.sqrt(jnp.where(step == 2, 0.0, 1.0) * params["w"] ** 2).sum()
    return {"loss": root}, 1.0

  stage = _stage()._replace(loss=loss)
  with pytest.raises(FloatingPointError, match="last good state is step 2"):
    train.train(config, tmp_path / "gradient", stage, _next_batch)
  assert Saver(tmp_path / "gradient").latest == 2
  with pytest.raises(FloatingPointError, match="last good"):
    train.train(_config(8), tmp_path / "slice", _stage(), lambda step: bad(2), max_seconds=0)
  assert checkpoint.is_fresh(tmp_path / "slice")
  skipping = train.train(_config(4, skip_loss=10.0), tmp_path / "skip", stage, _next_batch)
  assert np.isfinite(skipping.params["w"]).all() and read_metrics(tmp_path / "skip")[2]["skipped"] == 1


def _killed(step):
  raise MemoryError("as good as kill -9: nothing is saved, nothing cleaned up")


def test_a_killed_run_goes_on_as_if_it_had_not_been(tmp_path):
  """Killed at step 3 after its save at 2, with a line of metrics cut short; rows are neither doubled nor lost."""
  whole = train.train(_config(4), tmp_path / "whole", _stage(), _next_batch)
  folder = tmp_path / "parts"
  with pytest.raises(MemoryError):
    train.train(_config(4), folder, _stage(), lambda step: _next_batch(step) if step < 3 else _killed(step))
  with open(folder / "metrics.jsonl", "a") as file:
    file.write('{"step": 4, "lo')
  (folder / "params.safetensors").unlink()  # the end may come between checkpoint and parameters
  parts = train.train(_config(4), folder, _stage(), _next_batch, resume=True)
  chex.assert_trees_all_equal(parts, whole)
  assert [row["step"] for row in read_metrics(folder)] == [1, 2, 3, 4]
  assert _equal(checkpoint.load_params(folder), whole.ema_params) and not _equal(whole.ema_params, whole.params)
  assert _equal(checkpoint.load_params(folder, name=checkpoint.RAW), whole.params)


@pytest.mark.parametrize("resume", [False, True])
def test_a_run_killed_before_its_first_save_starts_anew(tmp_path, resume):
  with pytest.raises(MemoryError):
    train.train(_config(4), tmp_path, _stage(), lambda step: _next_batch(step) if step < 1 else _killed(step))
  assert len(read_metrics(tmp_path)) == 1 and checkpoint.is_fresh(tmp_path)
  state = train.train(_config(2), tmp_path, _stage(), _next_batch, resume=resume)
  assert int(state.step) == 2 and [row["step"] for row in read_metrics(tmp_path)] == [1, 2]


def test_a_write_cut_short_leaves_the_old_file(tmp_path):
  """By the operating system, which lets files hold no more than 15 bytes for a while."""
  stats = Stats(np.zeros(263, np.float32), np.ones(263, np.float32), get_layout("full"))
  saves = (lambda text: save_stats(stats, tmp_path), lambda text: checkpoint.save_text(tmp_path, "text.json", text),
           lambda text: append_metrics(tmp_path, {"step": 1}))
  for save in saves:
    save("old")
  before, limits = {path.name: path.read_bytes() for path in tmp_path.iterdir()}, resource.getrlimit(
      resource.RLIMIT_FSIZE)
  resource.setrlimit(resource.RLIMIT_FSIZE, (15, limits[1]))
  try:
    for save in saves:
      with pytest.raises(OSError):
        save("new" * 20)
  finally:
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
  assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_batch_with_a_wild_loss_is_skipped(tmp_path):
  wild = lambda step: _next_batch(step) | ({"y": np.full(8, 1e6, np.float32)} if step == 2 else {})
  two = train.train(_config(3, skip_loss=1e3), tmp_path / "b", _stage(), wild)
  assert _equal(two.params, train.train(_config(2, skip_loss=1e3), tmp_path / "c", _stage(), _next_batch).params)
  assert int(two.step) == 3 and read_metrics(tmp_path / "b")[-1]["skipped"] == 1


def before_each_step(monkeypatch, act):
  """Calls act(step) where a step of a training that begins anew takes its batch, which was made ahead of it."""
  take, steps = prefetch.Batches.take, itertools.count()
  monkeypatch.setattr(prefetch.Batches, "take", lambda self: (act(next(steps)), take(self))[1])


@pytest.mark.slow
def test_slices_of_a_run_choose_the_same_weights(tmp_path):
  """The best lie beside the last. A slice that ends at step 1, 3, 5, .. looks at the held-out number, which counts at a
  save alone; what is trained grows by about 0.1 a step."""
  values = {1: 0.1, 2: 3.0, 3: 0.2, 4: 1.0, 5: 0.3, 6: 2.0}
  number = lambda params: int(np.rint(10 * np.asarray(params["w"])[0]))
  stage = Stage(lambda batch, rng: {"w": jnp.zeros(1)},
                lambda params, frozen, batch, step, rng: ({"loss": -params["w"].sum()}, 1.0), None)
  config = _config(6, learning_rate=0.1, beta2=0.9, warmup_steps=0, clip_norm=0.0, ema_decay=0.0)
  config.train.best = "min held_out_loss"

  def kept(folder, **options):
    train.train(config, folder, stage, lambda step: {"index": np.arange(1)},
                evaluate=lambda params: {"held_out_loss": values[number(params)]}, **options)
    return [number(checkpoint.load_params(folder, name=name)) for name in (checkpoint.PARAMS, checkpoint.LAST)]

  for step in range(1, 7):
    assert kept(tmp_path, resume=step > 1, max_seconds=-1.0) == [{1: 1, 2: 2, 3: 2}.get(step, 4), step]
  whole = tmp_path / "whole"
  assert kept(whole) == [4, 6]
  for name in (checkpoint.PARAMS, checkpoint.LAST):
    assert (tmp_path / name).read_bytes() == (whole / name).read_bytes()
