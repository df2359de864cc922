"""A budget of processor time for a run: what its steps cost, over all the slices in which it is trained."""
import time
from collections.abc import Callable
from typing import Any

import jax


class Budget:
  """Counts the processor seconds of a run's steps, of all threads of this process, and says when they are spent.

  limit: seconds after which training ends; 0: no limit. spent: seconds up to now; they are saved with each state, so
  that the count continues when the run resumes. Start, evaluations and the first step of each shape of batches, in
  which the compiler's time is, are free.
  """

  def __init__(self, limit: float = 0.0, clock: Callable[[], float] = time.process_time):
    self.limit, self._clock, self._spent, self._since, self._shapes = limit, clock, 0.0, None, set()

  @property
  def spent(self) -> float:
    return self._spent + (0.0 if self._since is None else self._clock() - self._since)

  @property
  def is_spent(self) -> bool:
    return 0 < self.limit <= self.spent

  def before_step(self, batch: Any):
    """Counts from here on, unless batches of these shapes are new to this process."""
    shapes = tuple(leaf.shape for leaf in jax.tree.leaves(batch))
    (self.begin if shapes in self._shapes else self.pause)()
    self._shapes.add(shapes)

  def after_step(self, metrics: Any):
    """Counts from here on; with a limit, waits for the step, so that the clock does not run ahead of it."""
    if self.limit:
      jax.block_until_ready(metrics)
    self.begin()

  def begin(self):
    """Counts from here on."""
    if self._since is None:
      self._since = self._clock()

  def pause(self):
    """Stops the count up to the next `begin`."""
    self._spent, self._since = self.spent, None

  def restore(self, spent: float):
    """Takes over what a saved state had cost, before the first step. A rollback gives nothing back."""
    if self._since is None:
      self._spent = max(self._spent, spent)
