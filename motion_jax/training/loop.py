"""The training loop: batches in, a run folder out.

`train` reads top to bottom as training does: next batch, step, check, log, save, evaluate. `States` keeps what a run
must not lose: it restores, saves and rolls back.
"""
import contextlib
import dataclasses
import functools
import pathlib
import time
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

from motion_jax.training import checkpoint
from motion_jax.training.budget import Budget, Deadline
from motion_jax.training.compiling import Step, is_small
from motion_jax.training.distributed import Agreement, compile_together, end_together
from motion_jax.training.guards import BATCH, Guards, Watchdog, check_finite, keep_batch
from motion_jax.training.mesh import make_mesh
from motion_jax.training.metrics import Profile, Progress, Rates, flops_of
from motion_jax.training.optimizers import make_optimizer, make_schedule
from motion_jax.training.prefetch import Batches
from motion_jax.training.report import FILES, Outputs, is_disk_error
from motion_jax.training.saver import Saver, copy_of, describe_differences
from motion_jax.training.train_step import TrainState, init_state, make_train_step
from motion_jax.utils import stopping
from motion_jax.utils.atomic import remove_strays
from motion_jax.utils.errors import InputError, reason


def train(config, workdir, stage, next_batch, frozen=None, resume=False, evaluate=None, max_seconds=None,
          stop=None, profile_steps=None, draw=None):
  """Trains a stage in a run folder; returns the last TrainState.

  next_batch(step) -> dict of arrays with "index" (B,), a pure function of the step; with several processes it also
    takes rows=SLICE and returns those rows of the batch.
  frozen: arrays that the loss reads and training does not change.
  evaluate(params) -> dict of numbers, called on the averaged parameters at every save.
  max_seconds: saves and ends after so long. So does a signal, which is then in `stop` (a `stopping.Stop`); resume=True
    continues from there to the same bytes as a run without a pause. config.train.cpu_seconds: the same after so much
    processor time of the run's steps, its earlier slices included (`budget.Budget`). config.train.seconds: after
    these seconds of steps the run ends with its cooldown, for which it leaves out steps before (`budget.Deadline`).
  profile_steps (first, last): steps to trace into profile/. draw(params, path): see `report.Outputs`.

  Writes checkpoints/, params.safetensors (averaged where the config has an average), metrics.jsonl, report.html and
  loss.png. With config.train.best, such as "min held_out_loss", params.safetensors holds the parameters with the best
  value of that number at a save, of equals the last, and last.safetensors the last ones; "min a|b" takes the first of
  the numbers that `evaluate` returns. Only saves on the grid of train.save_every count, so that pauses change nothing.
  """
  num_steps, began = config.train.num_steps, time.time()
  mesh = make_mesh(config.mesh)
  tx = make_optimizer(config.optimizer, num_steps)
  rng = jax.random.key(config.seed)
  example = next_batch(0)
  states = States(config, workdir, mesh, stage, tx, example, rng, next_batch, evaluate, draw)
  state = states.begin(resume)
  frozen = mesh.put(frozen or {})
  train_step = _compiled_step(config, mesh, stage, tx, quick=is_small(state.params))
  first, batch_size, rows = int(state.step), len(example["index"]), slice(None)
  if jax.process_count() > 1:
    rows = mesh.own_rows(batch_size)
    next_batch = functools.partial(next_batch, rows=rows)
  sample = mesh.rows({name: array[rows] for name, array in example.items()})
  rates = Rates(batch_size, make_schedule(config.optimizer, num_steps),
                flops_of(train_step, state, frozen, sample, rng))
  with contextlib.ExitStack() as stack:
    opened = lambda thing: stack.enter_context(contextlib.closing(thing))
    progress = opened(Progress(first, num_steps, batch_size))
    opened(states)
    loop = Loop(config, states, state, train_step, rates, progress,
                watchdog=opened(Watchdog(workdir, config.train.hang_minutes)),
                batches=opened(Batches(next_batch, mesh.rows, num_steps, config.train.workers)),
                profile=opened(Profile(workdir, profile_steps, first)),
                signals=stack.enter_context(stop or stopping.Stop()), began=began, max_seconds=max_seconds)
    del state  # its buffers are donated
    step = loop.run(frozen, rng)
    states.finish(step)
  states.outputs.close()
  return loop.state


def _compiled_step(config, mesh, stage, tx, quick):
  optimizer = config.optimizer
  return Step(mesh.compiled(make_train_step(
      stage, tx, optimizer.ema_decay, optimizer.skip_loss, optimizer.skip_spikes, optimizer.accumulate_steps,
      tuple(config.train.get("freeze", ())), optimizer.ema_debias)), quick=quick)


@dataclasses.dataclass
class Loop:
  """The steps of a call of `train`, and what watches over them; state: the current one."""
  config: Any
  states: "States"
  state: TrainState
  train_step: Step
  rates: Rates
  progress: Progress
  watchdog: Watchdog
  batches: Batches
  profile: Profile
  signals: stopping.Stop
  began: float
  max_seconds: float | None

  def run(self, frozen, rng):
    """Runs the steps; returns the number of the last one."""
    states, train, agreement = self.states, self.config.train, Agreement()
    step = first = int(self.state.step)
    self.batches.begin(step, states.guards.batch_number(step))
    last = step if states.budget.is_spent else train.num_steps
    while step < last:
      batch = self._batch(step, first)
      if step == first:
        compile_together(self.train_step.compile, self.state, frozen, batch, rng)
      self._step(step, frozen, batch, rng)
      step += 1
      signal, ends = self._ending(agreement)
      logs = step % train.log_every == 0 or step == train.num_steps
      saves = step % train.save_every == 0 or step == train.num_steps or ends
      if (logs or saves) and states.is_lost(step):
        self.state = states.roll_back(self.state)
        step = self._jump(int(self.state.step))
        self.rates.restart()
        continue
      if logs:
        self.progress.show_row(states.log(step, self.began, self.rates))
      if logs and (cooldown := states.deadline.next_step(step)) != step:
        self.state, step, saves = states.skip_to(cooldown, self.state), self._jump(cooldown), True
      states.report_failed_save()
      if saves:
        self._save(step, signal, ends)
      if ends:
        break
    return step

  def _batch(self, step, first):
    try:
      return self.batches.take()
    except Exception as error:
      self.states.save_before_failing(step, self.state, first, error)
      raise InputError(f"the batch of step {step} cannot be made ({type(error).__name__}: {reason(error)}); step "
                       f"{self.states.saver.latest} is saved, --resume continues there once the data are whole"
                       ) from error

  def _step(self, step, frozen, batch, rng):
    """One step, whose metrics and time are kept."""
    states = self.states
    if self.profile.begin(step + 1, self.state):
      self.rates.restart()
    for limit in (states.budget, states.deadline):
      limit.before_step(batch)
    with jax.profiler.StepTraceAnnotation("train", step_num=step + 1):
      self.state, metrics = self.train_step(self.state, frozen, batch, rng)
    for limit in (states.budget, states.deadline):
      limit.after_step(metrics)
    self.rates.step(self.batches.waited)
    self.signals.something_to_lose()
    self.watchdog.beat()
    if self.profile.end(step + 1, self.state):
      self.rates.restart()
    states.unlogged.append(metrics)
    self.progress.step(step + 1, metrics)

  def _ending(self, agreement):
    """(the signal that any process received, or 0, whether the run ends now)."""
    is_late = self.max_seconds is not None and time.time() - self.began > self.max_seconds
    signal, out_of_time = agreement.largest(self.signals.number or 0, int(self.states.budget.is_spent or is_late))
    self.signals.hear(signal)
    return signal, bool(signal or out_of_time)

  def _jump(self, step):
    """Continues with the batches from another step on."""
    self.batches.begin(step, self.states.guards.batch_number(step))
    return step

  def _save(self, step, signal, ends):
    states = self.states
    states.save(step, self.state)
    if not ends:  # an evaluation may take minutes, which a signal does not leave
      self.signals.nothing_to_lose(lambda: (states.saver.wait(), end_together())[1])
    states.budget.pause()
    states.deadline.pause()
    self.progress.show_row(states.evaluate(step, self.state, hurried=bool(signal)))
    states.budget.begin()
    states.deadline.begin()
    self.watchdog.beat()
    self.rates.restart()


class States:
  """The states of a run, in memory and on disk: begins, checks, logs, saves, rolls back.

  Nothing is logged or saved before the guards have checked it. unlogged: the metrics of the steps since the last row.
  budget: the processor time of the steps.
  """

  def __init__(self, config, workdir, mesh, stage, tx, example, rng, next_batch, evaluate=None, draw=None):
    self.config, self.workdir = config, pathlib.Path(workdir)
    self._mesh, self._next_batch = mesh, next_batch
    init_rng = jax.random.fold_in(rng, 2**31 - 1)  # no step folds in this number
    optimizer = config.optimizer
    init = lambda batch, key: init_state(stage, tx, batch, key, optimizer.ema_decay > 0, optimizer.skip_spikes > 0)
    self._initial = lambda: mesh.init(init, example, init_rng)
    self.saver = Saver(workdir, config.train.keep_last, config.train.save_every)
    self.outputs = Outputs(workdir, config, evaluate, draw)
    self.guards = Guards(config)
    self.budget = Budget(config.train.get("cpu_seconds", 0.0))
    num_steps, cooldown = config.train.num_steps, optimizer.get("cooldown_steps", 0)
    self.deadline = Deadline(config.train.get("seconds", 0.0), num_steps - cooldown, num_steps)
    if self.deadline.limit and optimizer.schedule != "wsd":
      raise InputError(f"got train.seconds and optimizer.schedule {optimizer.schedule!r}, expected 'wsd', whose last "
                       "optimizer.cooldown_steps can follow any step")
    self.unlogged = []

  def begin(self, resume):
    """The state to train from: a new one, or with resume the newest whole one in the folder."""
    state = self._initial()
    if jax.process_index() == 0:
      self.saver.clean()
      remove_strays(self.workdir, (*FILES, BATCH))
    if self.saver.latest is None:
      if resume and not checkpoint.is_fresh(self.workdir):
        raise FileNotFoundError(f"{self.workdir} has no checkpoint to resume from; start without --resume in an empty "
                                "folder")
      self.outputs.begin(0)
      return state
    if not resume:
      raise ValueError(f"{self.workdir} holds a run at step {self.saver.latest}; --resume continues it, or choose "
                       "another folder")
    state, record = self._restore(state)
    if note := describe_differences(record):
      print(note)
    self.evaluate(int(state.step), state)  # a kill between a save and its evaluation leaves this undone
    return state

  def _restore(self, like):
    """The newest whole state on disk and its record; guards and metrics are again as they were at its step."""
    state, record = self.saver.restore(like, tqdm.write)
    step, memory = int(state.step), record.get("memory", {})
    self.guards.restore(memory, step)
    self.budget.restore(memory.get("cpu_seconds", 0.0))
    self.deadline.restore(memory.get("step_seconds", 0.0))
    self.unlogged = memory.get("logged", [])
    self.outputs.begin(step)
    return self._mesh.put(state), record

  def is_lost(self, step):
    """Has the guards check the metrics since the last row; returns whether the run has to be rolled back."""
    self.unlogged = [{key: float(value) for key, value in metrics.items()} for metrics in self.unlogged]
    try:
      return self.guards.check(step, self.unlogged, tqdm.write)
    except FloatingPointError as error:
      raise self._broken(error) from None

  def _broken(self, error):
    """The error that ends a run; the batch at which it was noticed is kept."""
    self.saver.wait()
    step = self.guards.step
    kept = keep_batch(self.workdir, step, self._next_batch(self.guards.batch_number(step - 1)))
    return FloatingPointError(f"{error}; the last good state is step {self.saver.sound}, the batch is in {kept}. Try a "
                              "lower optimizer.learning_rate, and `motion-jax data doctor`")

  def log(self, step, began, rates):
    """Writes the row of metrics of the steps since the last one, and returns it."""
    means = {name: float(np.mean([metrics[name] for metrics in self.unlogged])) for name in self.unlogged[0]}
    self.unlogged = []
    row = {"step": step, "seconds": round(time.time() - began, 1), **means, **self.guards.counts(), **rates.row(step),
           "cpu_seconds": round(self.budget.spent, 2)}
    self.outputs.add(row)
    return row

  def save(self, step, state):
    """Starts to save a state; the files are written while the next steps are computed."""
    if error := self.saver.wait():
      report_unsaved(error)
    copy = copy_of(state)
    try:
      check_finite(copy)
    except FloatingPointError as error:
      raise self._broken(error) from None
    self.saver.save(step, copy, self._memory())
    if self.saver.latest is None and (error := self.saver.wait()):  # weights without a state could not be resumed
      report_unsaved(error)

  def _memory(self):
    seconds = {"cpu_seconds": round(self.budget.spent, 3)} | (
        {"step_seconds": round(self.deadline.spent, 3)} if self.deadline.limit else {})
    return self.guards.memory() | {"logged": list(self.unlogged)} | seconds

  def evaluate(self, step, state, hurried=False):
    """Evaluates what was saved and keeps the best parameters; returns the numbers."""
    may_be_rolled_back = self.guards.streak and step < self.config.train.num_steps
    self.saver.best = self.outputs.after_save(step, state, hurried=hurried or may_be_rolled_back)
    return self.outputs.numbers

  def roll_back(self, state):
    """The last good state before a series of skipped steps; the run continues from it with other batches."""
    guards, most = self.guards, self.config.train.max_rollbacks
    if guards.window == most:
      raise self._broken(f"{guards.streak} steps in a row were skipped up to step {guards.step}, after {guards.window} "
                         "rollbacks")
    if error := self.saver.wait():
      report_unsaved(error)
    window, target = guards.window + 1, self.saver.sound
    tqdm.write(f"step {guards.step}: {guards.streak} steps in a row were skipped; rolling back to step {target or 0}, "
               f"then other batches (rollback {window} of {most})")
    if target is None:
      state, target = self._initial(), 0
      self.saver.save(target, copy_of(state))  # before later ones go: a folder without a state could not be resumed
      if error := self.saver.wait():
        raise error
    self.saver.discard_after(target)
    state, _ = self._restore(state)
    guards.window = window
    self.saver.remember(int(state.step), self._memory())
    return state

  def skip_to(self, step, state):
    """The state as it would be called after more steps, with its counts, for a run that leaves them out."""
    more = step - int(state.step)
    tqdm.write(f"step {int(state.step)}: {self.deadline.spent:.4g} of {self.deadline.limit:.4g} seconds are spent, the "
               f"rest is for the cooldown; continuing at step {step}")
    count = lambda leaf: leaf + more if leaf.shape == () and np.issubdtype(leaf.dtype, np.integer) else leaf
    return self._mesh.put(state.replace(step=state.step + more, opt_state=jax.tree.map(count, state.opt_state)))

  def save_before_failing(self, step, state, first, error):
    """Saves the state of the step whose batch could not be made; raises the error where there is nothing to save."""
    if step == first or isinstance(error, MemoryError):  # without memory for a batch there is none for a save
      raise error
    self.saver.wait()
    if self.saver.latest != step and not self.is_lost(step):
      self.save(step, state)
      self.saver.wait()

  def report_failed_save(self):
    """Reports a save that has failed in the background."""
    if error := self.saver.failure():
      report_unsaved(error)

  def finish(self, step):
    """Waits for the last save and removes states that are no longer needed."""
    if error := self.saver.wait():
      raise OSError(f"the state of step {step} could not be saved ({reason(error)}); the last saved one is step "
                    f"{self.saver.latest}") from error
    self.saver.prune()
    if self.budget.is_spent:
      tqdm.write(f"{self.budget.spent:.4g} of {self.budget.limit:.4g} processor seconds are spent at step {step}; a "
                 "larger train.cpu_seconds with --resume continues there")
    elif step < self.config.train.num_steps:
      tqdm.write(f"stopped and saved at step {step}; --resume continues there")

  def close(self):
    self.saver.close()


def report_unsaved(error):
  """Reports a state that could not be saved for lack of disk; raises any other error."""
  if not is_disk_error(error):
    raise error
  tqdm.write(f"a state could not be saved ({reason(error)}); training continues, older states are intact, the next "
             "save tries again")
