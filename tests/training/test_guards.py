"""What goes wrong in a run is provoked, and noticed before anything of it is saved."""
import contextlib
import errno
import io
import threading

import numpy as np
import pytest

from motion_jax.training import checkpoint, guards, report, saver
from motion_jax.training import loop as train
from motion_jax.training.guards import WINDOW
from motion_jax.training.metrics import read_metrics, without_clock
from motion_jax.training.saver import Saver
from motion_jax.utils.errors import InputError
from tests import processes
from tests.conftest import devices_env
from tests.training.test_train import _config, _equal, _killed, _next_batch, _stage


def _wild(number):
  return _next_batch(number) | {"y": np.full(8, 1e6, np.float32)}


def _bad_from(first, windows=1):
  """Batches that are wild from a step on, in the first windows."""
  return lambda number: (_wild if number % WINDOW >= first and number // WINDOW < windows else _next_batch)(number)


def _skipping(num_steps, **fields):
  config = _config(num_steps, skip_loss=1e3)
  config.train.update(max_skips=3, **fields)
  return config


def _rows(folder):
  return without_clock(read_metrics(folder))


@pytest.fixture(scope="module")
def rolled_back(tmp_path_factory):
  """(state, rows of metrics, what it printed) of a run that goes back once and that is not killed."""
  folder = tmp_path_factory.mktemp("whole")
  with contextlib.redirect_stdout(io.StringIO()) as printed:
    state = train.train(_skipping(10), folder, _stage(), _bad_from(5))
  return state, _rows(folder), printed.getvalue()


def test_a_run_goes_back_and_on_with_other_batches(tmp_path, rolled_back):
  """From the state before the steps that were left out, with batches that only seed, step and the count decide."""
  state, rows, printed = rolled_back
  assert "step 6 is skipped: loss 1e+12, gradient" in printed and "3 in a row" in printed
  assert "3 steps in a row were skipped; rolling back to step 4, then other batches (rollback 1 of 3)" in printed
  other = train.train(_config(10, skip_loss=1e3), tmp_path / "b", _stage(),
                      lambda step: _next_batch(step if step < 4 else step + WINDOW))
  assert _equal(state, other)
  assert [row["step"] for row in rows] == list(range(1, 11))
  assert [row.get("rollbacks", 0) for row in rows] == [0] * 4 + [1] * 6


@pytest.mark.parametrize("place, after", [("discard_after", True), ("remember", False)])
def test_a_kill_inside_a_rollback_changes_nothing(tmp_path, monkeypatch, rolled_back, place, after):
  real = getattr(Saver, place)

  def killed(self, *args):
    if after:
      real(self, *args)
    raise MemoryError

  monkeypatch.setattr(Saver, place, killed)
  with pytest.raises(MemoryError):
    train.train(_skipping(10), tmp_path, _stage(), _bad_from(5))
  monkeypatch.undo()
  parts = train.train(_skipping(10), tmp_path, _stage(), _bad_from(5), resume=True)
  assert _equal(rolled_back[0], parts) and _rows(tmp_path) == rolled_back[1]


@pytest.mark.slow
def test_slices_of_a_run_are_rolled_back_as_the_whole_one(tmp_path):
  """Three bad steps between two rows of metrics, good ones after them: whoever looks there earlier decides the same."""
  config = _skipping(12, log_every=6, save_every=6)
  bad = lambda number: (_wild if number in (7, 8, 9) else _next_batch)(number)
  whole = train.train(config, tmp_path / "whole", _stage(), bad)
  for attempt in range(30):
    parts = train.train(config, tmp_path / "parts", _stage(), bad, resume=attempt > 0, max_seconds=-1)
    if int(parts.step) == 12:
      break
  assert _equal(whole, parts) and _rows(tmp_path / "whole") == _rows(tmp_path / "parts")
  assert _rows(tmp_path / "whole")[-1]["rollbacks"] == 1 and Saver(tmp_path / "parts").steps == [6, 12]


def test_a_run_without_a_state_goes_back_to_its_start(tmp_path):
  config = _skipping(6, save_every=100)
  state = train.train(config, tmp_path / "a", _stage(), _bad_from(1))
  other = train.train(config, tmp_path / "b", _stage(), lambda step: _next_batch(step + WINDOW))
  assert _equal(state, other) and [row["step"] for row in _rows(tmp_path / "a")] == [1, 2, 3, 4, 5, 6]


def test_after_some_rollbacks_a_run_ends_and_keeps_the_batch(tmp_path):
  with pytest.raises(FloatingPointError, match="3 steps in a row were skipped up to step 8, after 2 rollbacks; "
                                               "the last good state is step 4"):
    train.train(_skipping(20, max_rollbacks=2), tmp_path, _stage(), _bad_from(5, windows=9))
  with np.load(tmp_path / guards.BATCH, allow_pickle=False) as kept:
    assert int(kept["step"]) == 8 and (kept["y"] == 1e6).all() and set(kept) == {"x", "y", "mask", "index", "step"}
    np.testing.assert_array_equal(kept["x"], _next_batch(7 + 2 * WINDOW)["x"])
  assert np.isfinite(checkpoint.load_params(tmp_path)["w"]).all()


def test_a_run_in_which_no_step_was_taken_is_no_success(tmp_path):
  """Shorter than the patience for steps that are left out."""
  config = _skipping(2)
  config.train.max_skips = 100
  with pytest.raises(FloatingPointError, match="2 steps in a row were skipped"):
    train.train(config, tmp_path, _stage(), _bad_from(0, windows=9))


def test_parameters_that_are_no_numbers_are_not_saved(tmp_path):
  """Loss and gradient of the step that breaks them are sound."""
  config = _config(4, learning_rate=1e39)
  config.train.save_every = 1
  with pytest.raises(FloatingPointError, match=r"the parameter params\['w'\] is not finite; the last good state is "
                                               "step None"):
    train.train(config, tmp_path, _stage(), _next_batch)
  assert checkpoint.is_fresh(tmp_path) and (tmp_path / guards.BATCH).is_file()


def _spiked(step):
  return _wild(step) if step == 20 else _next_batch(step)


@pytest.mark.slow
def test_a_spike_of_the_gradient_is_told_and_left_out_where_the_config_says_so(tmp_path, capsys):
  train.train(_config(24), tmp_path / "counted", _stage(), _spiked)
  assert "step 21: loss 1e+12, gradient" in (said := capsys.readouterr().out) and ", usually " in said
  assert [row.get("gradient_spikes", 0) for row in _rows(tmp_path / "counted")] == [0] * 20 + [1] * 4
  for step, factor in ((26, 50.0), (28, 0.0)):  # the guard may be put up and taken down
    state = train.train(_config(step, skip_spikes=factor), tmp_path / "counted", _stage(), _next_batch, resume=True)
    assert int(state.step) == step and (state.norms is None) == (factor == 0)
  config = _config(24, skip_spikes=50.0)
  whole = train.train(config, tmp_path / "left out", _stage(), _spiked)
  rows = _rows(tmp_path / "left out")
  assert [row["skipped"] for row in rows] == [0] * 20 + [1] + [0] * 3 and rows[-1]["skipped_steps"] == 1
  assert rows[23]["loss"] < 1e3
  folder = tmp_path / "killed"  # what is usual is part of the state
  with pytest.raises(MemoryError):
    train.train(config, folder, _stage(), lambda number: _killed(number) if number == 19 else _spiked(number))
  again = train.train(config, folder, _stage(), _spiked, resume=True)
  np.testing.assert_array_equal(again.norms, whole.norms)  # nan where there is none yet
  assert _equal(again.replace(norms=None), whole.replace(norms=None)) and _rows(folder) == rows


_STUCK = """
import pathlib, sys, threading
from motion_jax.training import lock
from motion_jax.training.guards import Watchdog
def stuck_here():
  threading.Event().wait()
with lock.locked(sys.argv[1]):
  Watchdog(sys.argv[1], 0.005)
  stuck_here()
"""


@pytest.mark.slow
def test_a_run_that_hangs_says_where_and_ends(tmp_path):
  done = processes.run(["-c", _STUCK, tmp_path], devices_env(1))
  assert done.returncode == 70 and "no step has ended for 0.005 minutes (train.hang_minutes)" in done.stderr
  assert "in stuck_here" in (tmp_path / guards.STACKS).read_text()
  assert [path.name for path in tmp_path.iterdir()] == [guards.STACKS]  # the lock is gone


def test_every_step_is_told_to_the_watchdog(tmp_path, monkeypatch):
  beats = []
  monkeypatch.setattr(guards.Watchdog, "beat", lambda self: beats.append(threading.current_thread().name) or
                      setattr(self, "_last", float("inf")))
  train.train(_config(5), tmp_path, _stage(), _next_batch)
  assert len(beats) >= 6 and set(beats) == {"MainThread"}


def _no_room(*_):
  raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.slow
def test_a_full_disk_ends_no_training(tmp_path, monkeypatch, capsys):
  """The save at step 4 fails, older states stay, the one at step 6 is there; rows of metrics are written later."""
  whole = train.train(_config(6), tmp_path / "whole", _stage(), _next_batch)
  real, folder = saver.write_record, tmp_path / "run"
  monkeypatch.setattr(saver, "write_record", lambda aside, record: _no_room() if record["step"] == 4 else
                      real(aside, record))
  append = report.append_metrics
  monkeypatch.setattr(report, "append_metrics", lambda folder, row: _no_room() if row["step"] == 3 and next(
      full, False) else append(folder, row))
  full = iter([True])
  state = train.train(_config(6), folder, _stage(), _next_batch)
  said = capsys.readouterr().out.replace("[Errno 28] ", "")
  assert "a state could not be saved (No space left on device" in said and "metrics.jsonl could not be written" in said
  assert [row["step"] for row in _rows(folder)] == [1, 2, 3, 4, 5, 6]
  assert _equal(state, whole) and Saver(folder).steps == [2, 6]
  assert [path.name for path in (folder / "checkpoints").iterdir() if not path.name.isdigit()] == []
  monkeypatch.setattr(saver, "write_record", _no_room)
  with pytest.raises(OSError, match="the state of step 8 could not be saved .* the last saved one is step 6"):
    train.train(_config(8), folder, _stage(), _next_batch, resume=True)
  assert Saver(folder).steps == [2, 6]


def test_data_that_fail_are_named_and_the_state_is_saved(tmp_path):
  def failing(step):
    if step == 3:
      raise KeyError("walk_07")
    return _next_batch(step)

  with pytest.raises(InputError, match=r"the batch of step 3 cannot be made \(KeyError: 'walk_07'.*step 3 is saved"):
    train.train(_config(6), tmp_path / "a", _stage(), failing)
  rest = train.train(_config(6), tmp_path / "a", _stage(), _next_batch, resume=True)
  assert _equal(rest, train.train(_config(6), tmp_path / "b", _stage(), _next_batch))
