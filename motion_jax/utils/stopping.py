"""How a program ends on a signal: cleaned up, with one line, and with the exit status that shells expect.

Only the command line uses this; the library itself leaves signals alone.
"""
import contextlib
import os
import signal
import sys
import threading

from motion_jax.utils import exit_status
from motion_jax.utils.exit_status import PIPE_CLOSED

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_undo = []  # functions that remove what is half done, the newest last


@contextlib.contextmanager
def undone_by(function):
  """While the block runs, a signal that ends the program calls function() first, to remove what is half done."""
  _undo.append(function)
  try:
    yield
  finally:
    _undo.remove(function)


def take_back():
  """Calls the functions of `undone_by`, the newest first; those that fail, as a thread may still write, are retried."""
  for function in reversed(_undo):
    for _ in range(3):
      with contextlib.suppress(Exception):
        function()
        break


_CLEAN = "stopped; nothing half-written is left"
_ending = threading.Lock()  # taken by the thread that ends the process, for good
_ended_by = None


def _end(program, number, resumable, message=_CLEAN, quiet=False):
  """Ends the process at once: removes what is half done, prints one line unless quiet, exits with the signal's status.

  It runs once, even if a thread gets one signal and a handler a second one."""
  global _ended_by
  if not _ending.acquire(blocking=False):
    if _ended_by == threading.get_ident():
      return  # a handler that interrupts this very function
    threading.Event().wait()
  _ended_by = threading.get_ident()
  take_back()
  with contextlib.suppress(Exception):  # a closed terminal
    sys.stdout.flush()
  status = exit_status.of_signal(number, resumable)
  said = "preempted, resumable" if status == exit_status.PREEMPTED else message
  if not quiet:
    with contextlib.suppress(OSError):
      os.write(2, ("\n" * os.isatty(2) + f"{program}: {said}\n").encode())  # not behind a progress bar
  os._exit(status)


@contextlib.contextmanager
def at_once(program, message=_CLEAN, resumable=False):
  """In the block SIGINT, SIGTERM and SIGHUP end the program at once: what is half done is removed, one line is printed.

  No exception is raised, because code of others could swallow it (a module that is being imported, a callback). Does
  nothing outside the main thread, where Python sets no handlers. resumable: for a training, `exit_status.PREEMPTED`.
  """
  def end(number, frame):
    for other in _SIGNALS:
      signal.signal(other, signal.SIG_IGN)  # an impatient second one must not cut the cleaning short
    _end(program, number, resumable, message)

  before = {}
  if threading.current_thread() is threading.main_thread():
    # A signal that is ignored stays ignored: nohup, a job in the background.
    before = {number: signal.signal(number, end) for number in _SIGNALS if signal.getsignal(number) != signal.SIG_IGN}
  try:
    yield
  finally:
    for number, handler in before.items():
      signal.signal(number, handler)


class Stop:
  """Turns the first SIGINT, SIGTERM or SIGHUP into a flag, so that a training stops between two steps.

  In `with stop:` .raised becomes True; a second signal acts as it did before. Afterwards .status is the exit status of
  a training that was stopped this way, 0 otherwise.

  program: its name; with one, a signal ends the program at once while there is nothing to lose: from the start until
  `something_to_lose`, and again after `nothing_to_lose`. A thread receives the signal, because Python's handlers wait
  for the main thread, which may be compiling for minutes.

  quiet: another process of the run prints how it ended.
  """

  def __init__(self, program=None):
    self.number, self.quiet = None, False
    self._program, self._depth = program, 0
    self._may_end, self._before_end = program is not None, None
    self._lock = threading.RLock()

  @property
  def raised(self) -> bool:
    return self.number is not None

  @property
  def status(self) -> int:
    return exit_status.of_signal(self.number, resumable=True)

  def something_to_lose(self):
    """From now on a signal only sets the flag."""
    with self._lock:
      self._may_end = False

  def nothing_to_lose(self, before_end=None):
    """From now on a signal ends a named program at once, after before_end(), unless that returns False."""
    with self._lock:
      self._may_end, self._before_end = self._program is not None, before_end
      if self.raised:
        self._heard(self.number)

  def _heard(self, number):
    with self._lock:
      self.number = self.number or number
      if self._may_end:
        ends = None
        if self._before_end is not None:
          with contextlib.suppress(Exception):
            ends = self._before_end()
        if ends is not False:
          _end(self._program, self.number, resumable=True, quiet=self.quiet)

  def hear(self, number):
    """Takes a signal that another process of the run has received; 0: none."""
    self.number = self.number or number or None

  def __enter__(self):
    self._depth += 1
    if self._depth == 1:
      self._before, self._pipe = {}, None
      if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
          if signal.getsignal(number) != signal.SIG_IGN:
            self._before[number] = signal.signal(number, self._note)
        if self._program is not None:
          self._listen()
    return self

  def _listen(self):
    ear, mouth = self._pipe = os.pipe()
    os.set_blocking(mouth, False)
    self._mouth_before = signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)

    def hear():
      while number := os.read(ear, 1)[0]:
        if number in self._before:
          self._heard(number)

    self._thread = threading.Thread(target=hear, name="signals", daemon=True)
    self._thread.start()

  def _note(self, number, frame):
    self.number = self.number or number
    self._restore()

  def _restore(self):
    for number, handler in self._before.items():
      signal.signal(number, handler)

  def __exit__(self, *_):
    self._depth -= 1
    if self._depth:
      return
    self._restore()
    if self._pipe is not None:
      signal.set_wakeup_fd(self._mouth_before)
      os.write(self._pipe[1], b"\0")
      self._thread.join()
      for end in self._pipe:
        os.close(end)


def flush() -> int:
  """Flushes stdout; returns 0, or PIPE_CLOSED, silently, where the reader, such as `head`, is gone."""
  try:
    if sys.stdout is not None:
      sys.stdout.flush()
    return 0
  except BrokenPipeError:
    return pipe_closed()


def pipe_closed() -> int:
  """Discards further output, so that the interpreter's last flush does not fail; returns the exit status."""
  with contextlib.suppress(OSError, ValueError, AttributeError):
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
  return PIPE_CLOSED
