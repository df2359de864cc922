"""Progress of long work: which part runs, how much of it is done, for how long. Work reports it, others read it.

  with progress.part("compiling"):              # anywhere in the library; costs nothing without a reader
    ...
  for image in progress.each(images, "wave.gif", 120, "frame"):
    ...

The command line calls `show`, the studio `follow`s each request. Nothing is reported by default.
"""
import contextlib
import contextvars
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any

FIRST = 0.5    # seconds until a command prints its first line,
SILENCE = 2.0  # until it prints another part of its work,
AGAIN = 5.0    # and until it repeats a line for the same part
_current: contextvars.ContextVar["Work | None"] = contextvars.ContextVar("work", default=None)


class Cancelled(Exception):
  """Raised inside work that another thread has cancelled, where it reports its progress."""


class Work:
  """One piece of work and how far it is; one thread reports, any thread reads or cancels it."""

  def __init__(self) -> None:
    self.began = time.monotonic()
    self.doing, self.done, self.total, self.unit = "", 0, 0, ""
    self.cancelled = False

  def state(self) -> dict[str, Any]:
    return {"doing": self.doing, "done": self.done, "of": self.total, "unit": self.unit,
            "seconds": round(time.monotonic() - self.began, 1)}

  def __str__(self) -> str:
    return self.doing + (f", {self.unit} {min(self.done + 1, self.total)} of {self.total}" if self.total > 1 else "")


@contextlib.contextmanager
def follow(work: Work) -> Iterator[Work]:
  """Directs the progress reports of the block, in this thread, to `work`."""
  token = _current.set(work)
  try:
    yield work
  finally:
    _current.reset(token)


@contextlib.contextmanager
def part(doing: str) -> Iterator[None]:
  """Reports that this part runs, until it ends and the part around it continues."""
  work = _current.get()
  if work is None:
    yield
    return
  check()
  before = work.doing, work.done, work.total, work.unit
  work.doing, work.done, work.total, work.unit = doing, 0, 0, ""
  try:
    yield
  finally:
    work.doing, work.done, work.total, work.unit = before


def check() -> None:
  """Raises `Cancelled` if the work that runs was cancelled."""
  if (work := _current.get()) is not None and work.cancelled:
    raise Cancelled


def count(done: int, total: int, unit: str) -> None:
  """Reports how much of the part that runs is done."""
  check()
  if (work := _current.get()) is not None:
    work.done, work.total, work.unit = done, total, unit


def each(items: Iterable[Any], doing: str, total: int | None = None, unit: str = "") -> Iterator[Any]:
  """Yields the items of a part, and reports how many there were."""
  total = total if total is not None else len(items) if hasattr(items, "__len__") else 0
  with part(doing):
    for done, item in enumerate(items):
      count(done, total, unit)
      yield item


class Lines:
  """The lines that a command prints about its work: the first one soon, further ones after two seconds of silence."""

  def __init__(self, work: Work) -> None:
    self.work, self._said, self._last = work, "", work.began

  def due(self, now: float) -> str | None:
    """A line that is due at a time of `time.monotonic`, or None."""
    doing = self.work.doing
    wait = FIRST if not self._said else AGAIN if doing == self._said else SILENCE
    if not doing or now - self._last < wait:
      return None
    self._said, self._last = doing, now
    return f"working: {self.work} ({now - self.work.began:.0f} s)"


def show() -> None:
  """Prints the progress of this command on stderr from now on."""
  if _current.get() is None:
    work = Work()
    _current.set(work)
    threading.Thread(target=_report, args=(Lines(work),), name="progress", daemon=True).start()


def _report(lines):
  while True:
    time.sleep(0.2)
    if line := lines.due(time.monotonic()):
      with contextlib.suppress(OSError, ValueError, AttributeError):  # a closed stderr
        print(line, file=sys.stderr, flush=True)
