"""How a program ends when it is told to: cleaned up, with one line, and with the exit status that shells expect.

The command line uses this; the library itself leaves signals alone.
"""
import contextlib
import os
import signal
import sys
import threading

PIPE_CLOSED = 128 + 13  # what a program has that SIGPIPE ended; 13 on every system that has pipes
_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_undo = []  # functions that take back what is half done, the newest last


def status_of(number) -> int:
  """The exit status of a program that a signal has stopped: 130 after Ctrl-C, 143 after SIGTERM; 0 for None."""
  return 0 if number is None else 128 + int(number)


@contextlib.contextmanager
def undone_by(function):
  """While the block runs a signal that ends the program calls function() first: it takes back what is half done."""
  _undo.append(function)
  try:
    yield
  finally:
    _undo.remove(function)


def take_back():
  """Calls what `undone_by` names, the newest first; what fails, as a thread may still be writing, is tried again."""
  for function in reversed(_undo):
    for _ in range(3):
      with contextlib.suppress(Exception):
        function()
        break


@contextlib.contextmanager
def at_once(program, message="stopped; nothing half-written is left"):
  """In the block SIGINT, SIGTERM and SIGHUP end the program where it stands: what is half done is taken back, one line.

  No exception is raised, for code of others may swallow it: a module that is being imported, a callback. Does nothing
  outside the main thread, where Python sets no handlers.
  """
  def end(number, frame):
    for other in _SIGNALS:
      signal.signal(other, signal.SIG_IGN)  # an impatient second one must not cut the cleaning short
    take_back()
    with contextlib.suppress(Exception):  # a closed terminal
      sys.stdout.flush()
    with contextlib.suppress(OSError):
      os.write(2, ("\n" * os.isatty(2) + f"{program}: {message}\n").encode())  # not behind a progress bar
    os._exit(status_of(number))

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
  """Turns the first SIGINT, SIGTERM or SIGHUP into a flag, so that a loop stops between two steps.

  In `with stop:` .raised becomes True; a second signal does what signals did before. Afterwards .status is the exit
  status of a program that was stopped so, 0 if it was not.
  """

  def __init__(self):
    self.number = None

  @property
  def raised(self) -> bool:
    return self.number is not None

  @property
  def status(self) -> int:
    return status_of(self.number)

  def __enter__(self):
    self._before = {}
    if threading.current_thread() is threading.main_thread():
      for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
          self._before[number] = signal.signal(number, self._note)
    return self

  def _note(self, number, frame):
    self.number = number
    self._restore()

  def _restore(self):
    for number, handler in self._before.items():
      signal.signal(number, handler)

  def __exit__(self, *_):
    self._restore()


def flush() -> int:
  """Flushes what was printed; 0, or PIPE_CLOSED where the reader, such as `head`, has gone: then without a word."""
  try:
    if sys.stdout is not None:
      sys.stdout.flush()
    return 0
  except BrokenPipeError:
    return pipe_closed()


def pipe_closed() -> int:
  """Sends what is still printed nowhere, so that the interpreter's last flush does not complain; the exit status."""
  with contextlib.suppress(OSError, ValueError, AttributeError):
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
  return PIPE_CLOSED
