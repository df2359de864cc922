"""The numbers of a run: metrics.jsonl and its TensorBoard file, progress lines, rates, and traces of the profiler."""
import errno
import json
import os
import pathlib
import resource
import sys
import threading
import time

import jax
import numpy as np
from tqdm import tqdm

from motion_jax import charts
from motion_jax.training.distributed import by_first
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError, reason
from motion_jax.utils.input_files import read_json_lines
from motion_jax.utils.install import pip_install

METRICS = "metrics.jsonl"
# Columns that depend on the machine.
CLOCK = ("seconds", "cpu_seconds", "samples_per_second", "data_wait", "memory_mb", "mfu")
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
  """The one event file of a run folder, always consistent with metrics.jsonl: it is written again from that at the
  start and after a failed write, so that each number is in it exactly once."""

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
  total, before, elapsed = 0.0, 0.0, []
  for row in rows:
    seconds = row.get("seconds", before)
    total += seconds - before if seconds >= before else seconds  # another slice counts from 0
    before = seconds
    elapsed.append(total)
  return [now - total + moment for moment in elapsed]


# --- progress: a bar on a terminal, otherwise lines -------------------------------------------------------------------


class Progress:
  """A progress bar on a terminal (where stderr is one), otherwise lines: often at first, then once a minute.

  Both show step, loss, samples per second and the time left; the bar also MFU, where known, and held-out numbers.
  """

  def __init__(self, first, num_steps, batch_size):
    self.first, self.num_steps, self.batch_size = first, num_steps, batch_size
    self.began = self.last_line = time.monotonic()
    self.warm = None  # when the first step ended, which waits for the compiler
    self.bar = tqdm(total=num_steps, initial=first, unit="step", dynamic_ncols=True, disable=None)
    self._numbers = {}  # from rows of metrics, for the bar
    self._compiled = threading.Event()
    if first < num_steps:
      threading.Thread(target=self._report_compiling, daemon=True).start()

  def _report_compiling(self, every=5):
    """Prints a line every few seconds until the first step is compiled."""
    while not self._compiled.wait(every):
      tqdm.write(f"step {self.first} of {self.num_steps}: compiling the first step, "
                 f"{time.monotonic() - self.began:.0f} s so far")
      sys.stdout.flush()

  def close(self):
    self._compiled.set()
    self.bar.close()

  def show_row(self, row):
    """Takes MFU and held-out numbers from a row of metrics; the bar shows them from now on."""
    self._numbers |= {name: f"{value:.4g}" for name, value in row.items() if name.startswith(("held_out", "r1"))}
    if "mfu" in row:
      self._numbers["MFU"] = f"{100 * row['mfu']:.1f}%"

  def step(self, step, metrics):
    """Reports a finished step, unless a line was printed moments ago; after a rollback the step may be earlier."""
    if not self.bar.disable:
      self.bar.update(step - self.bar.n)
    line = self.line(step, metrics)
    if line and (self.bar.disable or step == self.first + 1):
      tqdm.write(line)
      sys.stdout.flush()

  def line(self, step, metrics) -> str | None:
    """The line to print after this step, or None where one was printed moments ago."""
    now, done = time.monotonic(), step - self.first
    interval = 5 if now - self.began < 60 or not self.bar.disable else 60
    if done > 2 and now - self.last_line < interval and step < self.num_steps:
      return None
    loss = float(metrics["loss"])  # waits until the step is done
    text = f"step {step} of {self.num_steps}: loss {loss:.4g}"
    now = self.last_line = time.monotonic()
    if self.warm is None:
      self._compiled.set()
      self.warm = now
      return f"{text}, the first step took {now - self.began:.0f} s, most of it for the compiler"
    rate = max(done - 1, 1) / max(now - self.warm, 1e-6)
    if not self.bar.disable:
      terms = {name: f"{float(metrics[name]):.4g}" for name in ("loss", "mse") if name in metrics}
      self.bar.set_postfix(terms | {"samples/s": f"{rate * self.batch_size:.1f}"} | self._numbers)
    return f"{text}, {rate * self.batch_size:.1f} samples/s, {duration((self.num_steps - step) / rate)} left"


def duration(seconds) -> str:
  """12 s, 3 min, 2 h 05 min."""
  minutes = round(seconds / 60)
  if seconds < 90:
    return f"{seconds:.0f} s"
  return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


# --- rates: samples per second, share of time spent waiting for data, memory, learning rate, MFU ----------------------

# Dense bfloat16 products, TFLOP/s, by the beginning of a device's name; NVIDIA's and Google's data sheets.
PEAKS = {"NVIDIA B200": 2250, "NVIDIA H200": 989, "NVIDIA H100 PCIe": 756, "NVIDIA H100": 989, "NVIDIA A100": 312,
         "NVIDIA L40S": 362, "NVIDIA L4": 121, "TPU v4": 275, "TPU v5 lite": 197, "TPU v5e": 197, "TPU v5": 459,
         "TPU v6 lite": 918, "TPU v6e": 918}


def peak_flops() -> float | None:
  """FLOP/s of all devices together by their data sheets, in bfloat16; None where they are unknown."""
  name = jax.devices()[0].device_kind
  known = next((rate for beginning, rate in PEAKS.items() if name.startswith(beginning)), None)
  return known and known * 1e12 * jax.device_count()


def flops_of(train_step, *args) -> float | None:
  """FLOPs of a compiled step on all devices, as XLA counts them; None where no peak is known to compare them with, or
  XLA gives no count."""
  if peak_flops() is None:
    return None
  cost = train_step.lower(*args).cost_analysis()  # of one device's rows
  return (cost or {}).get("flops", 0.0) * jax.device_count() or None


def memory_mb() -> float:
  """Peak memory: of the fullest local accelerator, or of this process where the devices keep no statistics."""
  peaks = [(device.memory_stats() or {}).get("peak_bytes_in_use") for device in jax.local_devices()]
  if any(peaks):
    return max(filter(None, peaks)) / 1e6
  return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


class Rates:
  """Numbers of the steps since the last row; `schedule(step)` is the learning rate, flops those of one step.

  Time is measured from the end of one step to the end of the next; whatever lies between a `restart` and the next step
  (compiling, a save, an evaluation) does not count.
  """

  def __init__(self, batch_size, schedule, flops=None):
    self._batch_size, self._schedule = batch_size, schedule
    self._flops, self._peak = flops, peak_flops()
    self._last, self._seconds, self._waited, self._steps = None, 0.0, 0.0, 0

  def restart(self):
    """Leaves out the time of the next step."""
    self._last = None

  def step(self, waited):
    """Counts a finished step; waited: seconds that steps have waited for data since the run began."""
    now = time.perf_counter(), waited
    if self._last is not None:
      self._seconds += now[0] - self._last[0]
      self._waited += now[1] - self._last[1]
      self._steps += 1
    self._last = now

  def row(self, step) -> dict[str, float]:
    """The numbers of the steps since the last row, up to `step`; call it when the results of `step` are there."""
    if self._last is not None:
      now = time.perf_counter()
      self._seconds += now - self._last[0]
      self._last = now, self._last[1]
    row = {"learning_rate": float(self._schedule(step - 1)), "memory_mb": round(memory_mb(), 1)}
    if self._steps and self._seconds > 0:
      rate = self._steps / self._seconds
      row |= {"samples_per_second": rate * self._batch_size, "data_wait": min(self._waited / self._seconds, 1.0)}
      if self._flops and self._peak:
        row["mfu"] = rate * self._flops / self._peak
    self._seconds, self._waited, self._steps = 0.0, 0.0, 0
    return row


# --- traces: what host and devices do in some steps, and when ---------------------------------------------------------


def check_profile_steps(steps, num_steps):
  """Raises InputError unless steps (first, last), or None, are among the steps 1 to num_steps of a run."""
  if steps and not 1 <= steps[0] <= steps[1] <= num_steps:
    raise InputError(f"got --profile-steps {steps[0]}:{steps[1]}, expected A:B with 1 <= A <= B <= {num_steps}, the "
                     "steps of this run")


class Profile:
  """Traces the steps (first, last) of a run, both included, counted from 1, into its folder profile/; None: none.

  With several processes the first one is traced. Steps that a resumed run has already done are left out, with a note.
  """

  def __init__(self, workdir, steps, done):
    """done: the step at which the run starts or resumes."""
    self._folder, self._steps, self._begun = pathlib.Path(workdir) / "profile", steps, None
    if steps and done >= steps[1]:
      tqdm.write(f"steps {steps[0]} to {steps[1]} are not traced: the run is at step {done} already")
    if jax.process_index() or not steps or done >= steps[1]:
      self._steps = None

  def begin(self, step, state) -> bool:
    """Called before each step with the state that it gets; returns whether a trace begins with it."""
    if self._begun is not None or not self._steps or not self._steps[0] <= step <= self._steps[1]:
      return False
    jax.block_until_ready(state)  # keeps earlier steps out of the trace
    self._begun = step
    jax.profiler.start_trace(self._folder)
    return True

  def end(self, step, state) -> bool:
    """Called after each step with the new state; returns whether the trace ends with it."""
    if self._begun is None or step < self._steps[1]:
      return False
    jax.block_until_ready(state)
    self._stop(step)
    return True

  def close(self):
    """Ends a trace in which the run was stopped."""
    if self._begun is not None:
      self._stop(None)

  def _stop(self, step):
    first, self._begun, self._steps = self._begun, None, None
    try:
      jax.profiler.stop_trace()
    except Exception as error:  # a library of its own writes it, and a failed trace must not end the training
      tqdm.write(f"the trace in {self._folder} could not be written ({reason(error)}); training continues")
      return
    span = f"steps {first} to {step} are" if step else f"the run from step {first} on is"
    tqdm.write(f"{span} traced in {self._folder}: *.trace.json.gz opens in https://ui.perfetto.dev, the folder in "
               "xprof and TensorBoard")
