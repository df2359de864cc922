"""Batches made ahead are those made one by one; a fault in the thread is raised where its batch is taken."""
import pathlib
import threading

import numpy as np
import pytest

from motion_jax import fit
from motion_jax.text.encoder import TextEncoder
from motion_jax.training.prefetch import Batches, Prefetch, in_processes
from motion_jax.utils import config_files
from tests.conftest import load_config, some_of

pytestmark = pytest.mark.usefixtures("kept_features")


def test_batches_come_in_order_and_not_too_far_ahead():
  made, allowed = [], threading.Semaphore(0)

  def make(step):
    made.append(step)
    allowed.release()
    return {"step": step}

  with Prefetch(make, 3, 9, depth=2) as batches:
    for _ in range(3):  # two in the queue and one in hand
      allowed.acquire(timeout=10)
    assert made == [3, 4, 5]
    assert [batches.take()["step"] for _ in range(6)] == [3, 4, 5, 6, 7, 8]
    with pytest.raises(RuntimeError, match="no batch is left"):
      batches.take()
  assert batches.waited >= 0


def test_what_is_raised_in_the_thread_is_raised_where_the_batch_is_taken():
  def make(step):
    if step == 1:
      raise OSError("the disk is gone")
    return step

  with Prefetch(make, 0, 4) as batches:
    assert batches.take() == 0
    with pytest.raises(OSError, match="the disk is gone"):
      batches.take()


def test_the_thread_ends_with_its_block():
  with Prefetch(lambda step: step, 0, 10**9) as batches:
    batches.take()
  assert not batches._thread.is_alive()


def shared_memory():
  """Names of blocks of shared memory, of any program."""
  return {path.name for path in pathlib.Path("/dev/shm").glob("psm_*")}


@pytest.mark.slow
def test_processes_make_the_same_batches_in_the_same_order():
  pytest.importorskip("grain")
  config = fit.resolve(load_config("cmdm_denoiser", "tiny"))[0]
  next_batch = fit.setups()[config.stage](config).next_batch
  before = shared_memory()
  made = list(in_processes(next_batch, 5, 9, num_workers=2))
  assert shared_memory() <= before, "batches come through pipes, nothing is left where a program ends"
  assert len(made) == 4
  for step, batch in zip(range(5, 9), made):
    for name, array in next_batch(step).items():
      np.testing.assert_array_equal(batch[name], array)


@pytest.mark.parametrize("name", some_of(
    [name for name in config_files.names() if "/" not in name], ["cmdm_denoiser", "cdamd_length"],
    ["tmr", "cmdm_tokenizer", "cdamd_rvq", "evaluator_matching"]))
def test_processes_make_the_rows_of_one_whole_batch(name, monkeypatch):
  """Also where a caption of another process's rows is the longest; and no caption but their own is encoded."""
  setup = fit.setups()[(config := fit.resolve(load_config(name, "tiny"))[0]).stage](config)
  encoded, feature = [], TextEncoder._feature
  monkeypatch.setattr(TextEncoder, "_feature", lambda self, text: (encoded.append(text), feature(self, text))[1])
  for step in range(4):
    whole = setup.next_batch(step)
    size, whole_count = len(whole["index"]), len(encoded)
    half = slice(size // 2, size)
    encoded.clear()
    parts = [setup.next_batch(step, rows=rows) for rows in (slice(0, size // 2), half)]
    assert len(encoded) <= whole_count
    encoded.clear()
    for key, array in whole.items():
      np.testing.assert_array_equal(np.concatenate([part[key] for part in parts]), array, err_msg=key)


def test_a_run_that_is_rolled_back_takes_other_batches():
  batches = Batches(lambda number: number, lambda batch: -batch, num_steps=6)
  batches.begin(2, 102)
  assert [batches.take() for _ in range(2)] == [-102, -103]
  batches.begin(1, 501)
  assert [batches.take() for _ in range(5)] == [-501, -502, -503, -504, -505]
  waited = batches.waited
  batches.close()
  assert batches.waited == waited > 0
