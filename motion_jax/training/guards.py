"""Guards of an unattended run: values that are not finite, series of skipped steps, hangs.

docs/training.md has a table of what can happen and what a run does.
"""
import collections
import faulthandler
import os
import pathlib
import sys
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.utils import exit_status, stopping
from motion_jax.utils.atomic import atomic_path

BATCH, STACKS = "bad_batch.npz", "hang.txt"
WINDOW = 10_000_019  # distance between the numbers of a run's batches before and after a rollback
_NORMS, _SPIKE = 64, 10.0  # a gradient above 10 times the median of the last 64 counts as a spike


class Guards:
  """Checks the metrics of every step, in order. Its memory is saved with a state, so that a run resumes exactly.

  window: number of rollbacks, by which batches are chosen. streak: number of skipped steps in a row up to now.
  skipped, spikes: number of skipped steps, and of gradients far above the usual, since the run began.
  """

  def __init__(self, config):
    self._skip_loss, self._skip_spikes = config.optimizer.skip_loss, config.optimizer.skip_spikes
    self._train = config.train
    self.restore({}, 0)

  def restore(self, memory, step):
    """Restores what `memory` returned at a step; {} at the start of a run."""
    self.step = step
    self.window, self.streak, self.skipped, self.spikes = (
        memory.get(name, 0) for name in ("window", "streak", "skipped", "spikes"))
    self._norms = collections.deque(memory.get("norms", ()), _NORMS)

  def memory(self) -> dict:
    return {"window": self.window, "streak": self.streak, "skipped": self.skipped, "spikes": self.spikes,
            "norms": list(self._norms)}

  def counts(self) -> dict:
    """The counts that are not 0, for a row of metrics."""
    counts = {"skipped_steps": self.skipped, "gradient_spikes": self.spikes, "rollbacks": self.window}
    return {name: value for name, value in counts.items() if value}

  def batch_number(self, step) -> int:
    """The number of the batch that a step takes: the step itself, shifted by WINDOW for each rollback."""
    return step + self.window * WINDOW

  def check(self, step, rows, report=print) -> bool:
    """Checks the metrics `rows` of the last steps up to `step`, each step once.

    Returns whether the run is lost: train.max_skips steps in a row were skipped, or all of its steps were. Raises
    FloatingPointError for a loss or gradient that is not finite in a step that was not skipped.
    """
    lines, lost = [], False
    for number, row in enumerate(rows, step - len(rows) + 1):
      if number <= self.step:
        continue
      loss, norm, skipped = row["loss"], row["grad_norm"], row.get("skipped", 0) > 0
      usual = np.median(self._norms) if len(self._norms) >= _NORMS // 4 else np.inf
      spike = norm > (self._skip_spikes or _SPIKE) * usual
      self.step = number
      if not np.isfinite([loss, norm]).all() and not skipped:
        raise FloatingPointError(f"the loss is {loss}, its gradient {norm} near step {step}")
      self.streak = self.streak + 1 if skipped else 0
      self.skipped += skipped
      lost |= self.streak >= self._train.max_skips  # even if good steps follow: when rows are checked must not matter
      self.spikes += bool(spike)
      if np.isfinite(norm):
        self._norms.append(norm)
      if skipped or spike:
        lines.append(f"step {number}{' is skipped' if skipped else ''}: loss {loss:.4g}, gradient {norm:.4g}"
                     + (f", usually {usual:.4g}" if spike else "") + (f", {self.streak} in a row" if skipped else ""))
    for line in lines[:3] + ([f"... and {len(lines) - 3} more such steps"] if len(lines) > 3 else []):
      report(line)
    return lost or self.streak == step == self._train.num_steps


def check_finite(copy):
  """Raises FloatingPointError that names a parameter with a value that is not finite; copy: of `saver.copy_of`."""
  finite = lambda leaf: bool(np.isfinite(leaf.astype(np.float32)).all() if isinstance(leaf, np.ndarray)
                             else jnp.isfinite(leaf).all())
  for part in ("params", "ema_params", "extra"):
    for path, leaf in jax.tree_util.tree_leaves_with_path(copy.get(part)):
      if not finite(leaf):
        raise FloatingPointError(f"the parameter {part}{jax.tree_util.keystr(path)} is not finite")


def keep_batch(workdir, step, batch) -> pathlib.Path:
  """Writes a batch, arrays by name, with the step that it belongs to; no pickles."""
  target = pathlib.Path(workdir) / BATCH
  if jax.process_index():  # with several processes the first one writes
    return target
  with atomic_path(target) as path:
    np.savez(path, allow_pickle=False, step=step, **{name: np.asarray(value) for name, value in batch.items()})
  return target


class Watchdog:
  """Ends the process with `exit_status.HUNG` if `beat` is not called for `minutes`; 0 turns it off.

  The stack of each thread is written to STACKS in the run folder.
  """

  def __init__(self, workdir, minutes):
    self._file, self._seconds = pathlib.Path(workdir) / STACKS, 60 * minutes
    self._ended = threading.Event()
    self.beat()
    if minutes:
      threading.Thread(target=self._watch, name="watchdog", daemon=True).start()

  def beat(self):
    self._last = time.monotonic()

  def close(self):
    self._ended.set()

  def _watch(self):
    left = lambda: max(self._last + self._seconds - time.monotonic(), 0.01)
    while not self._ended.wait(min(left(), threading.TIMEOUT_MAX)):
      if time.monotonic() - self._last >= self._seconds:
        self._bite()

  def _bite(self):
    try:
      with open(self._file, "w", encoding="utf-8") as file:
        faulthandler.dump_traceback(file, all_threads=True)
    finally:
      stopping.take_back()
      print(f"no step has ended for {self._seconds / 60:.3g} minutes (train.hang_minutes): the stack of "
            f"each thread is in {self._file}; --resume continues from the last state", file=sys.stderr, flush=True)
      os._exit(exit_status.HUNG)
