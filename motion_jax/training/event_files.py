"""metrics.jsonl as TensorBoard reads it: an event file beside it, of the extra `tensorboard`."""
import pathlib
import time

from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install

_PREFIX = "events"  # TensorBoard looks for the .out.tfevents. that follows


def check_extra(config):
  """Raises InputError if train.tensorboard is set and what writes event files is not installed."""
  if config.train.get("tensorboard"):
    try:
      import tensorboardX  # noqa: F401
    except ImportError as error:
      raise InputError(f"train.tensorboard needs tensorboardX: {pip_install('tensorboard')}, or set "
                       "train.tensorboard=False") from error


class EventFile:
  """The one event file of a run folder: a scalar for each number of each row of metrics.jsonl.

  `rewrite` makes it anew from the rows that are there, whatever a kill or a rollback has left: steps come once.
  """

  def __init__(self, workdir):
    self._workdir, self._writer = pathlib.Path(workdir), None

  def rewrite(self):
    """Makes the file from metrics.jsonl. Raises OSError where it cannot be written."""
    from tensorboardX.event_file_writer import EventsWriter
    from tensorboardX.proto.event_pb2 import Event, SessionLog
    self.close()
    for old in self._workdir.glob(f"{_PREFIX}.out.tfevents.*"):
      old.unlink()
    rows = read_metrics(self._workdir)
    self._writer = EventsWriter(str(self._workdir / _PREFIX))
    # With this a TensorBoard that has read the file before forgets what it knew.
    self._write(Event(wall_time=time.time(), step=0, session_log=SessionLog(status=SessionLog.START)))
    for row, at in zip(rows, _times(rows, time.time())):
      self._write(_event(row, at))
    self._flush()

  def add(self, row):
    """Appends the newest row of metrics.jsonl. Raises OSError where it cannot be written."""
    if self._writer is None:  # not begun, or cut short by a full disk
      self.rewrite()
    else:
      self._write(_event(row, time.time()))
      self._flush()

  def close(self):
    if self._writer is not None:
      writer, self._writer = self._writer, None
      writer.close()

  def _write(self, event):
    self._tried(lambda: self._writer.write_event(event))

  def _flush(self):
    self._tried(lambda: self._writer.flush())

  def _tried(self, act):
    try:
      act()
    except OSError:
      self._writer = None  # half of an event may be there
      raise


def _event(row, at):
  from tensorboardX.proto.event_pb2 import Event
  from tensorboardX.proto.summary_pb2 import Summary
  values = [Summary.Value(tag=name, simple_value=value) for name, value in row.items()
            if name not in ("step", "seconds") and isinstance(value, int | float)]
  return Event(wall_time=at, step=row["step"], summary=Summary(value=values))


def _times(rows, now):
  """When rows were written, if the run had never paused: those of training say how many seconds its slice took."""
  total, before, found = 0.0, 0.0, []
  for row in rows:
    seconds = row.get("seconds", before)
    total += seconds - before if seconds >= before else seconds  # a further slice counts from 0
    before = seconds
    found.append(total)
  return [now - total + one for one in found]
