"""A budget of processor time: what counts, what is free, and that a run in slices is the run at once."""
import chex
import numpy as np
import pytest

from motion_jax.training import loop
from motion_jax.training.budget import Budget, Deadline
from motion_jax.training.metrics import read_metrics
from motion_jax.training.saver import progress
from motion_jax.utils.errors import InputError
from tests.training.test_train import _config, _next_batch, _stage


class Clock:
  now = 0.0

  def __call__(self):
    return self.now


def test_steps_count_but_not_the_first_of_a_shape_nor_pauses():
  clock = Clock()
  budget = Budget(limit=5.0, clock=clock)
  batches = [{"x": np.zeros((2, 3))}, {"x": np.zeros((2, 3))}, {"x": np.zeros((2, 4))}, {"x": np.zeros((2, 4))}]
  for batch, spent in zip(batches, (0.0, 2.0, 2.0, 4.0)):
    budget.before_step(batch)
    clock.now += 2.0
    budget.after_step({})
    assert budget.spent == spent and not budget.is_spent
  budget.pause()
  clock.now += 100.0
  budget.begin()
  clock.now += 1.0
  assert budget.spent == 5.0 and budget.is_spent


def test_a_saved_count_is_taken_over_and_a_rollback_gives_nothing_back():
  clock = Clock()
  budget = Budget(clock=clock)
  budget.restore(7.0)
  budget.begin()
  clock.now += 1.0
  budget.restore(9.0)
  budget.pause()
  budget.restore(3.0)
  assert budget.spent == 8.0 and not budget.is_spent


@pytest.mark.slow
def test_a_run_ends_with_its_budget_and_a_larger_one_continues_to_the_same_bytes(tmp_path):
  config = _config(10_000)
  config.train.cpu_seconds = 0.02
  loop.train(config, tmp_path / "parts", _stage(), _next_batch)
  first, spent = progress(tmp_path / "parts")
  assert 0 < first < 10_000 and spent >= 0.02
  loop.train(config, tmp_path / "parts", _stage(), _next_batch, resume=True)
  assert progress(tmp_path / "parts") == (first, spent), "the budget is spent: no further step"
  config.train.cpu_seconds = spent + 0.02
  state = loop.train(config, tmp_path / "parts", _stage(), _next_batch, resume=True)
  last, total = progress(tmp_path / "parts")
  assert last > first and total >= spent + 0.02
  counts = [row["cpu_seconds"] for row in read_metrics(tmp_path / "parts") if "cpu_seconds" in row]
  assert counts == sorted(counts)
  whole = loop.train(_config(last), tmp_path / "whole", _stage(), _next_batch)
  chex.assert_trees_all_equal(state.params, whole.params)


def test_a_deadline_leaves_time_for_the_cooldown():
  """Two seconds a step: of 100 s, 20 steps of cooldown take 40."""
  clock, batch = Clock(), {"x": np.zeros((2, 3))}
  deadline = Deadline(100.0, cooldown=80, num_steps=100, clock=clock)
  skipped = []
  for step in range(1, 40):
    deadline.before_step(batch)
    clock.now += 2.0
    deadline.after_step({})
    skipped.append(deadline.next_step(step) != step)
  assert skipped.index(True) == 30, "the first step is free; after 30 more 60 s are spent"
  deadline.pause()
  clock.now += 10.0
  deadline.limit = deadline.spent + 21.0
  assert deadline.next_step(40) == 90, "ten steps are left, the last half of the cooldown"
  assert deadline.next_step(85) == 85 and Deadline(0.0, 80, 100, clock).next_step(50) == 50


def test_a_run_with_a_deadline_ends_with_its_cooldown(tmp_path):
  """Steps are left out, the learning rate falls to 0 at the last step; a later slice continues to the same bytes."""
  config = _config(100_000)
  config.optimizer.update(schedule="wsd", cooldown_steps=30)
  config.train.update(seconds=0.2, log_every=10, save_every=100_000)
  loop.train(config, tmp_path / "run", _stage(), _next_batch, max_seconds=1e-6)
  state = loop.train(config, tmp_path / "run", _stage(), _next_batch, resume=True)
  rows = [row for row in read_metrics(tmp_path / "run") if "learning_rate" in row]
  steps = [row["step"] for row in rows]
  assert steps[-1] == int(state.step) == 100_000 and len(steps) < 9_000
  assert rows[-1]["learning_rate"] < config.optimizer.learning_rate / 30 * 2


def test_a_deadline_needs_a_cooldown(tmp_path):
  config = _config(10)
  config.train.seconds = 1.0
  with pytest.raises(InputError, match="expected 'wsd'"):
    loop.train(config, tmp_path / "run", _stage(), _next_batch)
