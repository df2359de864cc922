"""Budgets of a run: the processor time of its steps, over all slices in which it is trained, and seconds to train."""
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


class Deadline(Budget):
  """A limit on the seconds of a run's steps: says when the run has to skip to its cooldown to end in time.

  limit: seconds of wall-clock time, counted as a Budget's; 0: no limit. cooldown: the step at which the learning rate
  begins to fall; num_steps: that at which it has fallen, both of the longest run. A slower run skips the steps before
  its cooldown that it has no time for, and so ends with a learning rate of 0 like any run.
  """

  def __init__(self, limit: float, cooldown: int, num_steps: int, clock: Callable[[], float] = time.monotonic):
    super().__init__(limit, clock)
    self.cooldown, self.num_steps, self._num_timed, self._before = cooldown, num_steps, 0, 0.0

  def before_step(self, batch: Any):
    super().before_step(batch)
    self._num_timed += self._since is not None

  def after_step(self, metrics: Any):
    self.begin()

  def restore(self, spent: float):
    super().restore(spent)
    self._before = self._spent

  def next_step(self, step: int) -> int:
    """The step to continue with: the next one, or the first of the cooldown, or a later one of it where the time is too
    short for all of it; at least an eighth of the cooldown is left."""
    if not self.limit or step >= self.cooldown or not self._num_timed:
      return step
    seconds_per_step = (self.spent - self._before) / self._num_timed
    left, cooldown = int((self.limit - self.spent) / seconds_per_step), self.num_steps - self.cooldown
    return step if left > cooldown else self.num_steps - max(left, -(-cooldown // 8))
