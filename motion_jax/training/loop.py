"""The training loop: batches in, a run folder out; saves, metrics, signals."""
import contextlib
import pathlib
import sys
import time

import jax
import numpy as np
from tqdm import tqdm

from motion_jax.runtime import stopping
from motion_jax.training import checkpoint
from motion_jax.training.mesh import make_mesh
from motion_jax.training.metrics import append_metrics, draw_curve, read_metrics, trim_metrics, was_evaluated
from motion_jax.training.optimizers import make_optimizer
from motion_jax.training.progress import Progress
from motion_jax.training.saver import Saver, copy_of, told_differences
from motion_jax.training.train_step import init_state, make_train_step, variables_of


def train(config, workdir, stage, next_batch, frozen=None, resume=False, evaluate=None, max_seconds=None,
          stop=None):
  """Trains a stage in a run folder; returns the last TrainState.

  next_batch(step) -> dict of arrays with "index" (B,), a pure function of the step. frozen: arrays that the loss reads
  and nobody changes. evaluate(params) -> dict of numbers, called on the averaged parameters at every save. The folder
  gets checkpoints/, params.safetensors (averaged if there is an average), metrics.jsonl and loss.png. max_seconds ends
  a slice of a long run early; --resume goes on exactly where it ended; a signal does so, too, which
  stop (a `stopping.Stop`) then tells. config.train.best, such as "min held_out_loss"
  or "max r1", keeps in params.safetensors those for which that number of `evaluate` was best at a save, the later one
  of equals; the last ones are in last.safetensors then. "min held_out_fid|held_out_mm" takes the first number that
  `evaluate` gives. A slice that ends between two saves chooses nothing, so that slices make no difference.
  """
  workdir = pathlib.Path(workdir)
  mesh = make_mesh(config.mesh)
  num_steps, optimizer = config.train.num_steps, config.optimizer
  tx = make_optimizer(optimizer, num_steps)
  rng = jax.random.key(config.seed)
  init_rng = jax.random.fold_in(rng, 2**31 - 1)  # no step folds in this number
  example = next_batch(0)
  use_average = optimizer.ema_decay > 0
  state = mesh.put(jax.jit(lambda batch, key: init_state(stage, tx, batch, key, use_average))(example, init_rng))
  saver = Saver(workdir, config.train.keep_last)
  numbers, logged = {}, []

  def keep(state):
    checkpoint.save_params(workdir, variables_of(state, use_average))
    if use_average:  # references that have no average are judged without one
      checkpoint.save_params(workdir, variables_of(state), name=checkpoint.RAW)

  def judge(step, state, hurried=False):
    """What follows a save, and is made up for by a run that goes on after a kill between the two. hurried: less the
    evaluation, for a run that is told to end."""
    chooses = not hurried and (step % config.train.save_every == 0 or step == num_steps)
    params = variables_of(state, use_average)
    if chooses and evaluate is not None and not was_evaluated(workdir, step):
      numbers.update(evaluate(params))
      append_metrics(workdir, {"step": step, **numbers})
    saver.best = _best_step(config, workdir, step, chooses)
    if config.train.best:
      checkpoint.save_params(workdir, params, name=checkpoint.LAST)
    if saver.best == step or not (workdir / checkpoint.PARAMS).is_file():  # something is there at any time
      keep(state)

  saver.clean()
  going_on = saver.latest is not None
  if going_on:
    if not resume:
      raise ValueError(f"{workdir} holds a run at step {saver.latest}; --resume continues it, or choose another folder")
    restored, record = saver.restore(state)
    if told := told_differences(record):
      print(told)
    state = mesh.put(restored)
    logged += record.get("memory", {}).get("logged", [])
  elif resume and not checkpoint.is_fresh(workdir):
    raise FileNotFoundError(f"{workdir} has no checkpoint to resume from; start without --resume in an empty folder")
  trim_metrics(workdir, int(state.step))
  if going_on:
    judge(int(state.step), state)
  frozen = mesh.put(frozen or {})
  train_step = mesh.compiled(make_train_step(stage, tx, optimizer.ema_decay, optimizer.skip_loss))
  start = began = time.time()
  first = int(state.step)

  def check_finite(step):
    """Neither logged nor saved is what came of a step without a finite loss and gradient."""
    logged[:] = [{key: float(value) for key, value in metrics.items()} for metrics in logged]
    bad = [m for m in logged if not np.isfinite([m["loss"], m["grad_norm"]]).all()]
    if bad and not optimizer.skip_loss:  # which leaves such steps out
      saver.wait()
      raise FloatingPointError(f"the loss is {bad[0]['loss']}, its gradient {bad[0]['grad_norm']} near "
                               f"step {step}; the last good state is step {saver.latest}. Try a lower "
                               "optimizer.learning_rate, and `motion-jax data doctor`")

  def save(step):
    check_finite(step)
    if error := saver.wait():
      raise error
    saver.save(step, copy_of(state), {"logged": logged})

  progress = Progress(first, num_steps, len(example["index"]))
  bar = tqdm(total=num_steps, initial=first, unit="step", dynamic_ncols=True, disable=None)
  with contextlib.closing(progress), contextlib.closing(saver), (stop or stopping.Stop()) as interrupt, bar:
    step = first
    while step < num_steps:
      state, metrics = train_step(state, frozen, mesh.rows(next_batch(step)), rng)
      step += 1
      logged.append(metrics)
      if line := progress.line(step, metrics):
        tqdm.write(line)
        sys.stdout.flush()
      if step % config.train.log_every == 0 or step == num_steps:
        check_finite(step)
        means = {k: float(np.mean([m[k] for m in logged])) for k in logged[0]}
        logged.clear()
        append_metrics(workdir, {"step": step, "seconds": round(time.time() - began, 1), **means})
        bar.set_postfix({k: f"{v:.4g}" for k, v in means.items() if k in ("loss", "mse")} |
                        {k: f"{v:.4g}" for k, v in numbers.items()})
      bar.update(1)
      out_of_time = max_seconds is not None and time.time() - start > max_seconds
      if step % config.train.save_every == 0 or step == num_steps or interrupt.raised or out_of_time:
        save(step)
        judge(step, state, interrupt.raised)
      if interrupt.raised or out_of_time:
        tqdm.write(f"stopped and saved at step {step}; --resume goes on from there")
        break
  if error := saver.wait():
    raise error
  draw_curve(workdir)
  return state


def _best_step(config, workdir, step, chooses):
  """The step, up to this one, whose parameters are those to keep, by the number that config.train.best names.

  This one where it names none. chooses: raises ValueError unless this step has such a number. None where no step has.
  """
  if not config.train.best:
    return step
  way, _, names = config.train.best.partition(" ")
  grid = (config.train.save_every, config.train.num_steps)
  rows = [row for row in read_metrics(workdir) if row["step"] <= step and (
      row["step"] % grid[0] == 0 or row["step"] == grid[1]) and any(name in row for name in names.split("|"))]
  if chooses and not any(row["step"] == step for row in rows):
    raise ValueError(f"config.train.best names {names!r}, which the evaluation at step {step} did not give")
  if not rows:
    return None
  name = next(name for name in names.split("|") if name in rows[-1])
  values = {row["step"]: row[name] for row in rows if name in row}
  best = {"min": min, "max": max}[way](values.values())
  return max(at for at, value in values.items() if value == best)
