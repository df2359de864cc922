"""What a run writes beside its training states: rows of metrics, weights, the curve. A full disk ends no training."""
import contextlib
import pathlib

import jax
from tqdm import tqdm

from motion_jax.training import checkpoint, report
from motion_jax.training.distributed import on_host
from motion_jax.training.event_files import EventFile
from motion_jax.training.metrics import (
  METRICS,
  append_metrics,
  draw_curve,
  read_metrics,
  rounded,
  trim_metrics,
  was_evaluated,
)
from motion_jax.training.saver import environment
from motion_jax.training.train_step import variables_of
from motion_jax.utils.code import commit
from motion_jax.utils.errors import reason

FILES = (checkpoint.PARAMS, checkpoint.RAW, checkpoint.LAST, METRICS, "loss.png", report.REPORT)
_NO_ROOM = ("no space left", "enospc", "quota exceeded", "file too large", "os error", "input/output error")


def is_of_the_disk(error) -> bool:
  """Whether an error says that something cannot be written, by Python or by the library that writes states."""
  return isinstance(error, OSError) or any(words in str(error).lower() for words in _NO_ROOM)


@contextlib.contextmanager
def if_there_is_room(what):
  """In the block a file that cannot be written is told, and training goes on."""
  try:
    yield
  except OSError as error:
    tqdm.write(f"{what} could not be written ({reason(error)}); training goes on and tries again")


class Outputs:
  """Metrics and weights of a run folder. numbers: what the last evaluation gave."""

  def __init__(self, workdir, config, evaluate, draw=None):
    """draw(params, path): a picture of what the run makes, every train.sample_every steps."""
    self._workdir, self._config, self._evaluate = pathlib.Path(workdir), config, evaluate
    self._draw = draw
    self._average = config.optimizer.ema_decay > 0
    self._writes = jax.process_index() == 0  # of several processes the first
    self._rows = []  # those that could not be written yet
    self._events = EventFile(workdir) if config.train.tensorboard and self._writes else None
    self.numbers = {}

  def begin(self, step):
    """The run is at a step, which it may be for the second time: what came after it goes, for it comes again."""
    trim_metrics(self._workdir, step)
    for path in (self._workdir / report.SAMPLES).glob("step*.png") if self._writes else ():
      if path.stem[4:].isdigit() and int(path.stem[4:]) > step:
        path.unlink()
    self._with_events(lambda events: events.rewrite())

  def _with_events(self, act):
    if self._events is not None:
      with if_there_is_room("TensorBoard's event file"):
        act(self._events)

  def add(self, row):
    """A row of metrics.jsonl; what could not be written before comes first."""
    if self._writes:
      self._rows.append(rounded(row))
    with if_there_is_room("a row of metrics.jsonl"):
      while self._rows:
        append_metrics(self._workdir, self._rows[0])
        written = self._rows.pop(0)
        self._with_events(lambda events, row=written: events.add(row))

  def judge(self, step, state, hurried=False):
    """What follows a save, and is made up for by a run that goes on after a kill between the two.

    Evaluates the parameters, and keeps them if they are the best. hurried: less the evaluation, for a run that is told
    to end, and for a state that may be rolled back. Returns the step of the best ones, or None.
    """
    config, best = self._config, None
    chooses = not hurried and (step % config.train.save_every == 0 or step == config.train.num_steps)
    if jax.process_count() > 1:  # evaluated by each process on its own devices
      state = on_host(state.replace(opt_state=None))
    params = variables_of(state, self._average)
    if chooses and self._evaluate is not None and not was_evaluated(self._workdir, step):
      self.numbers.update(self._evaluate(params))
      self.add({"step": step, **self.numbers})
      tqdm.write(f"step {step}: " + ", ".join(f"{name} {value:.5g}" for name, value in self.numbers.items()))
    if not self._writes:
      return None
    with if_there_is_room("weights"):
      best = best_step(config, self._workdir, step, chooses and not self._rows)
      if config.train.best:
        checkpoint.save_params(self._workdir, params, name=checkpoint.LAST)
      if best == step or not (self._workdir / checkpoint.PARAMS).is_file():  # something is there at any time
        checkpoint.save_params(self._workdir, params)
        if self._average:  # references that have no average are judged without one
          checkpoint.save_params(self._workdir, variables_of(state), name=checkpoint.RAW)
      if chooses:
        self._show(step, params)
      self.report()
    return best

  def _show(self, step, params):
    """samples/stepNNNNNN.png, at the save of each sample_every-th step or the first one after it, and at the end."""
    every, path = self._config.train.sample_every, self._workdir / report.SAMPLES / f"step{step:06d}.png"
    if self._draw is None or path.exists() or (
        step % every >= self._config.train.save_every and step != self._config.train.num_steps):
      return
    try:
      self._draw(params, path)
    except Exception as error:  # no training of days ends by a picture
      tqdm.write(f"{path} could not be drawn ({type(error).__name__}: {reason(error)}); training goes on")

  def report(self):
    """report.html, made anew."""
    code = commit()
    about = environment() | {"commit": code["commit"] + " with changes" * code["changed"] if code else "not a checkout"}
    with if_there_is_room("report.html"):
      report.write(self._workdir, self._config, about)

  def close(self):
    self._with_events(lambda events: events.close())
    with if_there_is_room("loss.png"):
      if self._writes:
        draw_curve(self._workdir)


def best_step(config, workdir, step, chooses):
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
