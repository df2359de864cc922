"""A lock file in a folder, so that one program works in it at a time."""
import contextlib
import pathlib
import socket
import time

import filelock

from motion_jax.utils import stopping
from motion_jax.utils.errors import InputError

NAME = "run.lock"
_BRIEFLY, _UNREADABLE = 0.2, 3  # seconds; filelock replaces an unreadable lock that has not changed for two


@contextlib.contextmanager
def locked(folder):
  """Holds a folder's lock while the block runs. Raises InputError where another program holds it.

  A lock left by a dead program of this machine is taken over. Whether a program of another machine still runs cannot be
  checked, so the error names the file to delete if it does not.
  """
  path = pathlib.Path(folder) / NAME
  # A marker file with host, process and start time: file systems of clusters may lack flock, which FileLock needs.
  lock = filelock.SoftFileLock(path, thread_local=False)
  with contextlib.suppress(OSError):
    if not path.stat().st_size:  # of a machine that went down; filelock keeps empty locks, but replaces unreadable ones
      with path.open("a") as file:
        file.write("\n")
  try:
    lock.acquire(timeout=_BRIEFLY if lock.pid else _UNREADABLE)
  except filelock.Timeout:
    raise InputError(_in_use(path)) from None
  except OSError as error:
    raise OSError(f"cannot write {path}: {error.strerror or error}; choose a folder that you may write to") from error
  with stopping.undone_by(lock.release):
    try:
      yield
    finally:
      lock.release()


def _in_use(path):
  """The sentence about the lock of a program that runs, or of another machine."""
  try:
    (pid, host), since = path.read_text(encoding="utf-8").split("\n")[:2], path.stat().st_mtime
  except (OSError, ValueError):
    return f"{path.parent} is in use by a program that has just begun; choose another folder"
  name = host.partition("?")[0]  # filelock adds the process namespace of a container
  there = "" if host == socket.gethostname() else f"; if {name} does not run it any more, delete {path}"
  return (f"{path.parent} is in use by process {pid} on {name} since "
          f"{time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(since))}; wait for it, stop it, or choose another "
          f"folder{there}")
