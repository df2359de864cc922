"""metrics.jsonl of a run folder, one row of numbers per logged step, and the same rows as a TensorBoard event file."""
import errno
import json
import os
import pathlib
import time

import numpy as np

from motion_jax import charts
from motion_jax.training.distributed import by_first
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json_lines
from motion_jax.utils.install import pip_install

METRICS = "metrics.jsonl"
CLOCK = ("seconds", "samples_per_second", "data_wait", "memory_mb", "mfu")  # columns that depend on the machine
_PREFIX = "events"  # of event files: TensorBoard looks for the .out.tfevents. that follows


def read_metrics(folder) -> list[dict]:
  """The rows of a run, as dicts; an empty list where there is no file."""
  path = pathlib.Path(folder) / METRICS
  return [row for _, row in read_json_lines(path)] if path.is_file() else []


def without_clock(rows) -> list[dict]:
  """Rows without the columns that depend on the machine: equal for equal runs."""
  return [{key: value for key, value in row.items() if key not in CLOCK} for row in rows]


def was_evaluated(folder, step) -> bool:
  """Whether the evaluation after the save of a step has its row; rows of training have "seconds", evaluations not."""
  return any(row["step"] == step and "seconds" not in row for row in read_metrics(folder))


@by_first
def trim_metrics(folder, last):
  """Drops the rows of metrics.jsonl after step `last`, and a line cut short by a crash: a run that resumes there writes
  them again."""
  path = pathlib.Path(folder) / METRICS
  if not path.is_file():
    return
  lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
  kept = [line for line in lines if _step_of(line) <= last]
  if len(kept) < len(lines):
    with atomic_path(path) as whole:
      whole.write_text("".join(line + "\n" for line in kept), encoding="utf-8")


def _step_of(line):
  try:
    return json.loads(line)["step"]
  except (ValueError, KeyError, TypeError):
    return np.inf


def rounded(row) -> dict:
  """A row with its numbers rounded to the six digits that are written."""
  return {key: float(f"{value:.6g}") if isinstance(value, float) else value for key, value in row.items()}


@by_first
def append_metrics(folder, row):
  """Appends a row, a dict with its "step", to metrics.jsonl: all of it or nothing."""
  line = json.dumps(row) + "\n"
  with open(pathlib.Path(folder) / METRICS, "ab", buffering=0) as file:
    end = file.seek(0, os.SEEK_END)
    try:
      written = file.write(line.encode())
      if written < len(line):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError:
      file.truncate(end)
      raise


@by_first
def draw_curve(folder):
  """Draws loss.png: the loss over the steps, on a logarithmic axis where all values are positive."""
  points = [(row["step"], row["loss"]) for row in read_metrics(folder) if np.isfinite(row.get("loss", np.nan))]
  if not points:
    return
  steps, losses = zip(*points)
  # Sums of log-densities may be negative: then the axis is linear.
  image = charts.picture([charts.Series("", steps, losses)], "step", "loss", logarithmic=min(losses) > 0)
  with atomic_path(pathlib.Path(folder) / "loss.png") as path:
    image.save(path)


# --- TensorBoard (the extra `tensorboard`) ----------------------------------------------------------------------------


def check_tensorboard(config):
  """Raises InputError if train.tensorboard is set and tensorboardX is not installed."""
  if config.train.get("tensorboard"):
    try:
      import tensorboardX  # noqa: F401
    except ImportError as error:
      raise InputError(f"train.tensorboard needs tensorboardX: {pip_install('tensorboard')}, or set "
                       "train.tensorboard=False") from error


class EventFile:
  """The one event file of a run folder. metrics.jsonl is the truth: at the start, and whenever a write failed, the file
  is written again from it, so that each number is in it once whatever happened to the run."""

  def __init__(self, workdir):
    self._workdir, self._writer = pathlib.Path(workdir), None

  def rewrite(self):
    """Writes the file from metrics.jsonl. Raises OSError where it cannot be written."""
    from tensorboardX.event_file_writer import EventsWriter
    from tensorboardX.proto.event_pb2 import Event, SessionLog
    self.close()
    for old in self._workdir.glob(f"{_PREFIX}.out.tfevents.*"):
      old.unlink()
    rows = read_metrics(self._workdir)
    self._writer = EventsWriter(str(self._workdir / _PREFIX))
    # A TensorBoard that is open on the old file forgets it at this event.
    self._try(lambda: self._writer.write_event(
        Event(wall_time=time.time(), step=0, session_log=SessionLog(status=SessionLog.START))))
    for row, at in zip(rows, wall_times(rows, time.time())):
      self._try(lambda row=row, at=at: self._writer.write_event(_event(row, at)))
    self._try(lambda: self._writer.flush())

  def add(self, row):
    """Appends the newest row of metrics.jsonl. Raises OSError where it cannot be written."""
    if self._writer is None:  # not begun, or cut short by a full disk
      self.rewrite()
    else:
      self._try(lambda: self._writer.write_event(_event(row, time.time())))
      self._try(lambda: self._writer.flush())

  def close(self):
    if self._writer is not None:
      writer, self._writer = self._writer, None
      writer.close()

  def _try(self, write):
    try:
      write()
    except OSError:
      self._writer = None  # half of an event may be in the file
      raise


def _event(row, at):
  from tensorboardX.proto.event_pb2 import Event
  from tensorboardX.proto.summary_pb2 import Summary
  values = [Summary.Value(tag=name, simple_value=value) for name, value in row.items()
            if name not in ("step", "seconds") and isinstance(value, int | float)]
  return Event(wall_time=at, step=row["step"], summary=Summary(value=values))


def wall_times(rows, now):
  """When each row was written, pauses between slices left out: rows of training hold the seconds of their slice."""
  total, before, found = 0.0, 0.0, []
  for row in rows:
    seconds = row.get("seconds", before)
    total += seconds - before if seconds >= before else seconds  # another slice counts from 0
    before = seconds
    found.append(total)
  return [now - total + one for one in found]
