"""Outputs of a run besides its training states: weights, rows of metrics, report.html, pictures.

A full disk does not end a training: what cannot be written now is reported and written later.
"""
import base64
import contextlib
import json
import pathlib
import time
from typing import NamedTuple

import jax
import jinja2
import numpy as np
from tqdm import tqdm

from motion_jax import charts, look
from motion_jax.training import checkpoint
from motion_jax.training.code_version import commit
from motion_jax.training.distributed import on_host
from motion_jax.training.metrics import (
  METRICS,
  EventFile,
  append_metrics,
  draw_curve,
  duration,
  read_metrics,
  rounded,
  trim_metrics,
  was_evaluated,
)
from motion_jax.training.optimizers import parameters_to_use
from motion_jax.training.saver import environment
from motion_jax.training.train_step import variables_of
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import reason

REPORT, SAMPLES = "report.html", "samples"
FILES = (checkpoint.PARAMS, checkpoint.RAW, checkpoint.LAST, METRICS, "loss.png", REPORT)
_DISK_ERRORS = ("no space left", "enospc", "quota exceeded", "file too large", "os error", "input/output error")


def is_disk_error(error) -> bool:
  """Whether an error, of Python or of the library that writes states, means that something cannot be written."""
  return isinstance(error, OSError) or any(text in str(error).lower() for text in _DISK_ERRORS)


@contextlib.contextmanager
def tolerate_disk_errors(what):
  """Reports an OSError of the block in one line, and lets the training continue."""
  try:
    yield
  except OSError as error:
    tqdm.write(f"{what} could not be written ({reason(error)}); training continues and tries again")


class Outputs:
  """Metrics and weights of a run folder. numbers: those of the last evaluation."""

  def __init__(self, workdir, config, evaluate, draw=None):
    """draw(params, path): draws a sample of the run, every train.sample_every steps."""
    self._workdir, self._config, self._evaluate = pathlib.Path(workdir), config, evaluate
    self._draw = draw
    self._average = config.optimizer.ema_decay > 0
    self._writes = jax.process_index() == 0  # with several processes the first one writes
    self._rows = []  # those that could not be written yet
    self._events = EventFile(workdir) if config.train.tensorboard and self._writes else None
    self.numbers = {}

  def begin(self, step):
    """Starts or resumes at a step: rows and samples of later steps are removed, as the run writes them again."""
    trim_metrics(self._workdir, step)
    for path in (self._workdir / SAMPLES).glob("step*.png") if self._writes else ():
      if path.stem[4:].isdigit() and int(path.stem[4:]) > step:
        path.unlink()
    self._with_events(lambda events: events.rewrite())

  def _with_events(self, act):
    if self._events is not None:
      with tolerate_disk_errors("TensorBoard's event file"):
        act(self._events)

  def add(self, row):
    """Appends a row to metrics.jsonl, after those that could not be written before."""
    if self._writes:
      self._rows.append(rounded(row))
    with tolerate_disk_errors("a row of metrics.jsonl"):
      while self._rows:
        append_metrics(self._workdir, self._rows[0])
        written = self._rows.pop(0)
        self._with_events(lambda events, row=written: events.add(row))

  def after_save(self, step, state, hurried=False):
    """Evaluates the parameters and keeps them if they are the best; returns the step of the best ones, or None.

    A run that is killed between a save and this repeats it when it resumes. hurried: without the evaluation, for a run
    that has to end now, and for a state that may be rolled back.
    """
    config, best = self._config, None
    evaluates = not hurried and (step % config.train.save_every == 0 or step == config.train.num_steps)
    state = state.replace(params=parameters_to_use(state.opt_state, state.params), opt_state=None)
    if jax.process_count() > 1:  # each process evaluates on its own devices
      state = on_host(state)
    params = variables_of(state, self._average)
    if evaluates and self._evaluate is not None and not was_evaluated(self._workdir, step):
      self.numbers.update(self._evaluate(params))
      self.add({"step": step, **self.numbers})
      tqdm.write(f"step {step}: " + ", ".join(f"{name} {value:.5g}" for name, value in self.numbers.items()))
    if not self._writes:
      return None
    with tolerate_disk_errors("weights"):
      best = best_step(config, self._workdir, step, evaluates and not self._rows)
      if config.train.best:
        checkpoint.save_params(self._workdir, params, name=checkpoint.LAST)
      if best == step or not (self._workdir / checkpoint.PARAMS).is_file():  # weights are there at any time
        checkpoint.save_params(self._workdir, params)
        if self._average:  # released weights of some methods are not averaged: comparisons need both
          checkpoint.save_params(self._workdir, variables_of(state), name=checkpoint.RAW)
      if evaluates:
        self._draw_sample(step, params)
      self.write_report()
    return best

  def _draw_sample(self, step, params):
    """Draws samples/stepNNNNNN.png at the first save of each train.sample_every steps, and at the end."""
    every, path = self._config.train.sample_every, self._workdir / SAMPLES / f"step{step:06d}.png"
    if self._draw is None or path.exists() or (
        step % every >= self._config.train.save_every and step != self._config.train.num_steps):
      return
    try:
      self._draw(params, path)
    except Exception as error:  # a picture must not end a training of days
      tqdm.write(f"{path} could not be drawn ({type(error).__name__}: {reason(error)}); training continues")

  def write_report(self):
    """Writes report.html from the rows so far."""
    code = commit()
    about = environment() | {"commit": code["commit"] + " with changes" * code["changed"] if code else "not a checkout"}
    with tolerate_disk_errors("report.html"):
      write_report(self._workdir, self._config, about)

  def close(self):
    self._with_events(lambda events: events.close())
    with tolerate_disk_errors("loss.png"):
      if self._writes:
        draw_curve(self._workdir)


def best_step(config, workdir, step, required):
  """The step, up to this one, with the best value of the number that config.train.best names; of equals the last.

  This step where config.train.best is empty; None where no step has the number yet. required: raises ValueError unless
  this step has it.
  """
  if not config.train.best:
    return step
  way, _, names = config.train.best.partition(" ")
  grid = (config.train.save_every, config.train.num_steps)
  rows = [row for row in read_metrics(workdir) if row["step"] <= step and (
      row["step"] % grid[0] == 0 or row["step"] == grid[1]) and any(name in row for name in names.split("|"))]
  if required and not any(row["step"] == step for row in rows):
    raise ValueError(f"config.train.best names {names!r}, which the evaluation at step {step} did not give")
  if not rows:
    return None
  name = next(name for name in names.split("|") if name in rows[-1])
  values = {row["step"]: row[name] for row in rows if name in row}
  best = {"min": min, "max": max}[way](values.values())
  return max(at for at, value in values.items() if value == best)


# --- report.html: curves, speed, environment and config in one file that loads nothing from elsewhere -----------------

_SPEED = {"samples_per_second": "samples a second", "data_wait": "share of time spent waiting for data",
          "mfu": "MFU: share of the devices' peak in bfloat16", "memory_mb": "memory, MB"}
_STEPS = {"grad_norm": "norm of the gradient", "learning_rate": "learning rate", "skipped": "share of skipped steps"}
_LOGARITHMIC = ("loss", "grad_norm")
_NO_TERMS = {"step", "seconds", "loss", *_SPEED, *_STEPS}
_MAX_PICTURES = 6


class Figure(NamedTuple):
  """A chart: title, [(colour class, name)] of its lines, drawing."""
  title: str
  names: list[tuple[str, str]]
  svg: str


def write_report(workdir, config, environment) -> pathlib.Path:
  """Writes report.html from metrics.jsonl, samples/*.png and environment {label: value}; returns its path."""
  workdir = pathlib.Path(workdir)
  rows = read_metrics(workdir)
  trained, evaluated = [row for row in rows if "seconds" in row], [row for row in rows if "seconds" not in row]
  template = jinja2.Environment(autoescape=True, trim_blocks=True).from_string(
      (pathlib.Path(__file__).parent / "assets" / "report.html.j2").read_text(encoding="utf-8"))
  text = template.render(
      name=workdir.resolve().name, stage=config.get("stage", ""), step=max((row["step"] for row in rows), default=0),
      num_steps=config.train.num_steps, written=time.strftime("%Y-%m-%d %H:%M"), tiles=_tiles(trained, evaluated),
      sections=[section for section in _sections(trained, evaluated) if section[1]], pictures=_pictures(workdir),
      about=list(environment.items()), config=json.dumps(config.to_dict(), indent=1), style=look.page_style())
  with atomic_path(workdir / REPORT) as path:
    path.write_text(text, encoding="utf-8")
  return workdir / REPORT


def smoothed(values, over=0.05):
  """Exponential moving average over this share of the values, bias-corrected at the start."""
  keep, total, weight, means = 1 - 1 / max(over * len(values), 1), 0.0, 0.0, []
  for value in values:
    if np.isfinite(value):
      total, weight = keep * total + (1 - keep) * value, keep * weight + (1 - keep)
    means.append(total / weight if weight else value)
  return means


def _tiles(trained, evaluated):
  if not trained:
    return []
  last, tiles = trained[-1], []
  tiles.append(("loss", f"{smoothed([row['loss'] for row in trained])[-1]:.4g}"))
  tiles += [(name.replace("_", " "), f"{value:.4g}") for row in evaluated[-1:] for name, value in row.items()
            if name != "step"]
  tiles += [(_SPEED[name].partition(":")[0], f"{100 * last[name]:.1f} %" if name in ("data_wait", "mfu") else
             f"{last[name]:.4g}") for name in _SPEED if name in last]
  skipped = sum(row.get("skipped", 0.0) * (row["step"] - before) for row, before in zip(
      trained, [0] + [row["step"] for row in trained]))
  tiles += [("skipped steps", f"{skipped:.0f}")] if any("skipped" in row for row in trained) else []
  return tiles + [("time of training", duration(last["seconds"]))]


def _sections(trained, evaluated):
  terms = sorted({name for row in trained for name in row} - _NO_TERMS)
  yield "Loss", [figure for figure in (_loss(trained), *(_lines([term], trained, {}) for term in terms)) if figure]
  names = sorted({name for row in evaluated for name in row} - {"step"})
  yield "On held-out data", [figure for name in names if (figure := _lines([name], evaluated, {}))]
  yield "Steps", [figure for name in _STEPS if (figure := _lines([name], trained, _STEPS))]
  yield "Speed", [figure for name in _SPEED if (figure := _lines([name], trained, _SPEED))]


def _loss(rows):
  """The loss as logged, and smoothed."""
  points = [(row["step"], row["loss"]) for row in rows if np.isfinite(row.get("loss", np.nan))]
  if not points:
    return None
  steps, losses = zip(*points)
  lines = [charts.Series("as logged", steps, losses), charts.Series("smoothed", steps, smoothed(losses))]
  return _figure("loss", lines, "loss")


def _lines(names, rows, titles):
  lines = [charts.Series(name, *zip(*points)) for name in names if (
      points := [(row["step"], row[name]) for row in rows if np.isfinite(row.get(name, np.nan))])]
  return _figure(titles.get(names[0], names[0].replace("_", " ")), lines, names[0]) if lines else None


def _figure(title, lines, name):
  lowest = min(value for line in lines for value in line.y)
  svg = charts.svg(lines, "step", name.replace("_", " "), title, logarithmic=name in _LOGARITHMIC and lowest > 0)
  return Figure(title, [(kind, line.name) for kind, line in zip(charts.kinds(lines), lines)] if lines[1:] else [], svg)


def _pictures(workdir):
  pictures = sorted((workdir / SAMPLES).glob("step*.png"))
  kept = pictures[::-1][::max(1, -(-len(pictures) // _MAX_PICTURES))]  # the newest first
  return [(path.stem.replace("_", " "), base64.b64encode(path.read_bytes()).decode()) for path in kept]
