"""A trace of some steps of a run, by JAX's profiler: what host and devices do, and when."""
import pathlib

import jax
from tqdm import tqdm

from motion_jax.utils.errors import InputError, reason

FOLDER = "profile"


def check_steps(steps, num_steps):
  """Raises InputError unless steps (first, last), or None, are among the 1 to num_steps of a run."""
  if steps and not 1 <= steps[0] <= steps[1] <= num_steps:
    raise InputError(f"got --profile-steps {steps[0]}:{steps[1]}, expected A:B with 1 <= A <= B <= {num_steps}, the "
                     "steps of this run")


class Profile:
  """Traces the steps (first, last) of a run, both included, counted from 1, into its folder profile/; None: none.

  Of several processes the first is traced. Steps that a run which goes on has behind it are told and left out.
  """

  def __init__(self, workdir, steps, done):
    """done: how many steps the run has behind it."""
    self._folder, self._steps, self._begun = pathlib.Path(workdir) / FOLDER, steps, None
    if steps and done >= steps[1]:
      tqdm.write(f"steps {steps[0]} to {steps[1]} are not traced: the run is at step {done} already")
    if jax.process_index() or not steps or done >= steps[1]:
      self._steps = None

  def begin(self, step, state) -> bool:
    """Called before each step, with the state that it is given. Whether a trace begins with it."""
    if self._begun is not None or not self._steps or not self._steps[0] <= step <= self._steps[1]:
      return False
    jax.block_until_ready(state)  # earlier steps are not in it
    self._begun = step
    jax.profiler.start_trace(self._folder)
    return True

  def end(self, step, state) -> bool:
    """Called after each step, with what it gave. Whether the trace ends with it."""
    if self._begun is None or step < self._steps[1]:
      return False
    jax.block_until_ready(state)
    self._stop(step)
    return True

  def close(self):
    """Ends a trace in which a run was stopped."""
    if self._begun is not None:
      self._stop(None)

  def _stop(self, step):
    first, self._begun, self._steps = self._begun, None, None
    try:
      jax.profiler.stop_trace()
    except Exception as error:  # it is written by a library of its own, and no training ends by it
      tqdm.write(f"the trace in {self._folder} could not be written ({reason(error)}); training goes on")
      return
    span = f"steps {first} to {step} are" if step else f"what the run did from step {first} on is"
    tqdm.write(f"{span} traced in {self._folder}: *.trace.json.gz opens in https://ui.perfetto.dev, the folder in "
               "xprof and TensorBoard")
