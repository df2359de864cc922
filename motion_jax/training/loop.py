"""The training loop: batches in, a run folder out; saves, metrics, signals."""
import contextlib
import functools
import pathlib
import time

import jax
import numpy as np
from tqdm import tqdm

from motion_jax.training import checkpoint
from motion_jax.training.distributed import Agreement, compile_together, end_together
from motion_jax.training.guards import BATCH, Guards, Watchdog, check_finite, keep_batch
from motion_jax.training.mesh import make_mesh
from motion_jax.training.optimizers import make_optimizer, make_schedule
from motion_jax.training.outputs import FILES, Outputs, is_of_the_disk
from motion_jax.training.prefetch import Ahead
from motion_jax.training.profiling import Profile
from motion_jax.training.progress import Progress
from motion_jax.training.rates import Rates, flops_of
from motion_jax.training.saver import Saver, copy_of, told_differences
from motion_jax.training.train_step import init_state, make_train_step
from motion_jax.utils import stopping
from motion_jax.utils.atomic import remove_strays
from motion_jax.utils.errors import InputError, reason


def train(config, workdir, stage, next_batch, frozen=None, resume=False, evaluate=None, max_seconds=None,
          stop=None, profile_steps=None, draw=None):
  """Trains a stage in a run folder; returns the last TrainState.

  next_batch(step) -> dict of arrays with "index" (B,), a pure function of the step; of a run of several processes also
  next_batch(step, rows=a slice) -> those rows of it. frozen: arrays that the loss reads and nobody changes.
  evaluate(params) -> dict of numbers, called on the averaged parameters at every save. The folder gets checkpoints/,
  params.safetensors (averaged if there is an average), metrics.jsonl, report.html and loss.png.
  max_seconds ends a slice of a long run early; --resume goes on exactly where it ended; a signal does so, too, which
  stop (a `stopping.Stop`) then tells. config.train.best, such as "min held_out_loss" or "max r1", keeps in
  params.safetensors those for which that number of `evaluate` was best at a save, the later one of equals; the last
  ones are in last.safetensors then. "min held_out_fid|held_out_mm" takes the first number that `evaluate` gives. A
  slice that ends between two saves chooses nothing, so that slices make no difference. profile_steps (first, last) are
  traced into profile/. draw(params, path): see `Outputs`.
  """
  workdir = pathlib.Path(workdir)
  mesh = make_mesh(config.mesh)
  num_steps, optimizer = config.train.num_steps, config.optimizer
  tx = make_optimizer(optimizer, num_steps)
  rng = jax.random.key(config.seed)
  init_rng = jax.random.fold_in(rng, 2**31 - 1)  # no step folds in this number
  example = next_batch(0)
  use_average = optimizer.ema_decay > 0
  init = jax.jit(lambda batch, key: init_state(stage, tx, batch, key, use_average, optimizer.skip_spikes > 0))

  def initial():
    return init(example, init_rng)

  state = mesh.put(initial())
  saver = Saver(workdir, config.train.keep_last, config.train.save_every)
  outputs, guards, logged = Outputs(workdir, config, evaluate, draw), Guards(config), []

  def restore(state):
    """The newest whole state on disk, with what the guards and the next row of metrics know of it."""
    restored, record = saver.restore(state, tqdm.write)
    step, memory = int(restored.step), record.get("memory", {})
    guards.recall(memory, step)
    logged[:] = memory.get("logged", [])
    outputs.begin(step)
    return mesh.put(restored), record

  if jax.process_index() == 0:
    saver.clean()
    remove_strays(workdir, (*FILES, BATCH))
  if saver.latest is not None:
    if not resume:
      raise ValueError(f"{workdir} holds a run at step {saver.latest}; --resume continues it, or choose another folder")
    state, record = restore(state)
    if told := told_differences(record):
      print(told)
    saver.best = outputs.judge(int(state.step), state, hurried=guards.streak and int(state.step) < num_steps)
  elif resume and not checkpoint.is_fresh(workdir):
    raise FileNotFoundError(f"{workdir} has no checkpoint to resume from; start without --resume in an empty folder")
  else:
    outputs.begin(0)
  frozen = mesh.put(frozen or {})
  train_step = mesh.compiled(make_train_step(stage, tx, optimizer.ema_decay, optimizer.skip_loss,
                                             optimizer.skip_spikes, optimizer.accumulate_steps,
                                             tuple(config.train.get("freeze", ()))))
  start = began = time.time()
  first = int(state.step)

  def broken(error):
    """The error that ends a run, with the batch kept by which it was noticed."""
    saver.wait()
    kept = keep_batch(workdir, guards.step, next_batch(guards.batch_number(guards.step - 1)))
    return FloatingPointError(f"{error}; the last good state is step {saver.sound}, the batch is in {kept}. Try a "
                              "lower optimizer.learning_rate, and `motion-jax data doctor`")

  def look(step):
    """Nothing is logged or saved before the guards have seen it; whether the run is lost."""
    logged[:] = [{key: float(value) for key, value in metrics.items()} for metrics in logged]
    try:
      return guards.look(step, logged, tqdm.write)
    except FloatingPointError as error:
      raise broken(error) from None

  def save(step, state):
    if error := saver.wait():
      tell_unsaved(error)
    copy = copy_of(state)
    try:
      check_finite(copy)
    except FloatingPointError as error:
      raise broken(error) from None
    saver.save(step, copy, guards.memory() | {"logged": list(logged)})  # written while the next steps are logged

  def roll_back(state):
    """The last state before a series of steps that were left out, from which the run goes on with other batches."""
    if guards.window == config.train.max_rollbacks:
      raise broken(f"{guards.streak} steps in a row were left out up to step {guards.step}, after going back "
                   f"{guards.window} times")
    if error := saver.wait():
      tell_unsaved(error)
    window, to = guards.window + 1, saver.sound
    tqdm.write(f"step {guards.step}: {guards.streak} steps in a row were left out; back to step {to or 0} and on with "
               f"other batches (time {window} of {config.train.max_rollbacks})")
    if to is None:
      state, to = mesh.put(initial()), 0
      saver.save(to, copy_of(state))  # before others go: a folder without a state could not go on
      if error := saver.wait():
        raise error
    saver.discard_after(to)
    state, _ = restore(state)
    guards.window = window
    saver.remember(int(state.step), state, guards.memory() | {"logged": logged})
    return state

  def batch_of(step):
    try:
      return batches.take()
    except MemoryError:  # there is none for a save either
      raise
    except Exception as error:
      if step == first:
        raise
      saver.wait()
      if saver.latest != step and not look(step):
        save(step, state)
        saver.wait()
      raise InputError(f"the batch of step {step} cannot be made ({type(error).__name__}: {reason(error)}); step "
                       f"{saver.latest} is saved, --resume goes on from there when the data are whole") from error

  own, own_batch = slice(None), next_batch
  if jax.process_count() > 1:
    own = mesh.own_rows(len(example["index"]))
    own_batch = functools.partial(next_batch, rows=own)
  batches = Ahead(own_batch, mesh.rows, num_steps, config.train.workers)
  sample = mesh.rows({name: array[own] for name, array in example.items()})
  rates = Rates(len(example["index"]), make_schedule(optimizer, num_steps),
                flops_of(train_step, state, frozen, sample, rng))
  progress = Progress(first, num_steps, len(example["index"]))
  watchdog = Watchdog(workdir, config.train.hang_minutes)
  profile, agreement = Profile(workdir, profile_steps, first), Agreement()
  with (contextlib.closing(progress), contextlib.closing(saver), contextlib.closing(watchdog),
        contextlib.closing(batches), contextlib.closing(profile), stop or stopping.Stop() as interrupt):
    step = first
    if step < num_steps:
      batches.begin(step, guards.batch_number(step))
    while step < num_steps:
      batch = batch_of(step)
      if step == first:
        compile_together(train_step, state, frozen, batch, rng)
      if profile.begin(step + 1, state):
        rates.restart()
      with jax.profiler.StepTraceAnnotation("train", step_num=step + 1):
        state, metrics = train_step(state, frozen, batch, rng)
      rates.step(batches.waited)
      interrupt.something_to_lose()
      watchdog.beat()
      step += 1
      if profile.end(step, state):
        rates.restart()
      logged.append(metrics)
      progress.step(step, metrics)
      told, out_of_time = agreement.largest(interrupt.number or 0,
                                            int(max_seconds is not None and time.time() - start > max_seconds))
      interrupt.hear(told)
      ends = told or out_of_time
      logs = step % config.train.log_every == 0 or step == num_steps
      saves = step % config.train.save_every == 0 or step == num_steps or ends
      if (logs or saves) and look(step):
        state = roll_back(state)
        step = int(state.step)
        batches.begin(step, guards.batch_number(step))
        rates.restart()
        continue
      if logs:
        means = {k: float(np.mean([m[k] for m in logged])) for k in logged[0]}
        logged.clear()
        row = {"step": step, "seconds": round(time.time() - began, 1), **means, **guards.counts(), **rates.row(step)}
        outputs.add(row)
        progress.seen(row)
      if error := saver.failure():
        tell_unsaved(error)
      if saves:
        save(step, state)
        if saver.latest is None and (error := saver.wait()):  # weights without a state could not go on
          tell_unsaved(error)
        if not ends:  # what follows a save may take minutes, which a signal does not leave
          interrupt.nothing_to_lose(lambda: (saver.wait(), end_together())[1])
        # What may be rolled back is not chosen.
        saver.best = outputs.judge(step, state, hurried=told or guards.streak and step < num_steps)
        progress.seen(outputs.numbers)
        watchdog.beat()
        rates.restart()
      if ends:
        break
    if error := saver.wait():
      raise OSError(f"the state of step {step} could not be saved ({reason(error)}); the last that was is step "
                    f"{saver.latest}") from error
    saver.prune()
    if step < num_steps:
      tqdm.write(f"stopped and saved at step {step}; --resume goes on from there")
  outputs.close()
  return state


def tell_unsaved(error):
  """Says that a state was not saved; raises what is not the disk's fault."""
  if not is_of_the_disk(error):
    raise error
  tqdm.write(f"a state could not be saved ({reason(error)}); training goes on, older states are intact, the next save "
             "tries again")
