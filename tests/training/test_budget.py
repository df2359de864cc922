"""A budget of processor time: what counts, what is free, and that a run in slices is the run at once."""
import chex
import numpy as np

from motion_jax.training import loop
from motion_jax.training.budget import Budget
from motion_jax.training.metrics import read_metrics
from motion_jax.training.saver import progress
from tests.training.test_train import _config, _next_batch, _stage


class Clock:
  def __init__(self):
    self.now = 0.0

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
  budget.restore(3.0)
  budget.restore(9.0)
  assert budget.spent == 8.0 and not budget.is_spent


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


def test_a_folder_without_a_state(tmp_path):
  assert progress(tmp_path) == (0, 0.0)
