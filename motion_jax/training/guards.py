"""What may go wrong in a run that nobody watches: numbers that are none, steps that are left out, hangs.

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
WINDOW = 10_000_019  # steps between the batches of a run and those that it draws after being rolled back
_NORMS, _SPIKE = 64, 10.0  # so many gradients say what is usual; so many times that is a spike


class Guards:
  """Looks at the metrics of every step, in order. What it remembers is saved with a state: so a run resumes exactly.

  window: how often the run was rolled back, by which its batches are chosen. streak: how many of the last steps were
  left out. skipped, spikes: how many were, and how many gradients were far larger than usual, since the run began.
  """

  def __init__(self, config):
    self._skip_loss, self._skip_spikes = config.optimizer.skip_loss, config.optimizer.skip_spikes
    self._train = config.train
    self.recall({}, 0)

  def recall(self, memory, step):
    """Takes up what `memory` gave at a step; {} at the start of a run."""
    self.step = step
    self.window, self.streak, self.skipped, self.spikes = (
        memory.get(name, 0) for name in ("window", "streak", "skipped", "spikes"))
    self._norms = collections.deque(memory.get("norms", ()), _NORMS)

  def memory(self) -> dict:
    return {"window": self.window, "streak": self.streak, "skipped": self.skipped, "spikes": self.spikes,
            "norms": list(self._norms)}

  def counts(self) -> dict:
    """What a row of metrics tells of it, where there is something to tell."""
    told = {"skipped_steps": self.skipped, "gradient_spikes": self.spikes, "rollbacks": self.window}
    return {name: value for name, value in told.items() if value}

  def batch_number(self, step) -> int:
    """Which batch a step takes: its own number, and others after the run was rolled back."""
    return step + self.window * WINDOW

  def look(self, step, rows, tell=print) -> bool:
    """Looks at the metrics `rows` of the last steps up to `step`; those that it has seen are passed over.

    Returns whether the run is lost: nothing but steps left out for train.max_skips, or from its start to its end.
    Raises FloatingPointError for a loss or a gradient that is no number where no step is left out.
    """
    said, lost = [], False
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
      lost |= self.streak >= self._train.max_skips  # whatever came after: who looks earlier must not decide otherwise
      self.spikes += bool(spike)
      if np.isfinite(norm):
        self._norms.append(norm)
      if skipped or spike:
        said.append(f"step {number}{' is left out' if skipped else ''}: loss {loss:.4g}, gradient {norm:.4g}"
                    + (f", usually {usual:.4g}" if spike else "") + (f", {self.streak} in a row" if skipped else ""))
    for line in said[:3] + ([f"... and {len(said) - 3} more such steps"] if len(said) > 3 else []):
      tell(line)
    return lost or self.streak == step == self._train.num_steps


def check_finite(copy):
  """Raises FloatingPointError that names a parameter which is no number; copy: what `saver.copy_of` copied."""
  finite = lambda leaf: bool(np.isfinite(leaf.astype(np.float32)).all() if isinstance(leaf, np.ndarray)
                             else jnp.isfinite(leaf).all())
  for part in ("params", "ema_params", "extra"):
    for path, leaf in jax.tree_util.tree_leaves_with_path(copy.get(part)):
      if not finite(leaf):
        raise FloatingPointError(f"the parameter {part}{jax.tree_util.keystr(path)} is no number")


def keep_batch(workdir, step, batch) -> pathlib.Path:
  """Writes a batch, arrays by name, with the step that it came from; no pickles."""
  target = pathlib.Path(workdir) / BATCH
  if jax.process_index():  # of several processes the first writes
    return target
  with atomic_path(target) as path:
    np.savez(path, allow_pickle=False, step=step, **{name: np.asarray(value) for name, value in batch.items()})
  return target


class Watchdog:
  """Ends the process with `exit_status.HUNG` if `beat` is not called for so many minutes; 0 watches nothing.

  Where each thread stands then is written to a file of the run folder.
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
      print(f"no step has ended for {self._seconds / 60:.3g} minutes (train.hang_minutes): {self._file} says where "
            "each thread stands; --resume goes on from the last state", file=sys.stderr, flush=True)
      os._exit(exit_status.HUNG)
