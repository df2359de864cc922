"""A lock file in a folder, so that one program works in it at a time."""
import contextlib
import json
import os
import pathlib
import socket
import time

from motion_jax.utils import stopping
from motion_jax.utils.errors import InputError

NAME = "lock.json"


@contextlib.contextmanager
def locked(folder):
  """Holds a folder's lock while the block runs. Raises InputError where another program holds it.

  A lock left by a dead program of this machine is taken over. Whether a program of another machine still runs cannot be
  checked, so the error names the file to delete if it does not.
  """
  path = pathlib.Path(folder) / NAME
  own = {"host": socket.gethostname(), "pid": os.getpid(), "born": _born(os.getpid()),
         "since": time.strftime("%Y-%m-%d %H:%M:%S")}
  for _ in range(10):  # several may take over the same dead lock at once: one of them gets it
    try:
      handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
      break
    except FileExistsError:
      _remove_dead(path)
    except OSError as error:
      raise OSError(f"cannot write {path}: {error.strerror or error}; choose a folder that you may write to") from error
  else:
    raise InputError(f"{path} is taken again and again; choose another folder")
  release = lambda: path.unlink(missing_ok=True)
  with stopping.undone_by(release):
    try:
      with os.fdopen(handle, "w") as file:
        json.dump(own, file)
      yield
    finally:
      release()


def _remove_dead(path):
  """Removes the lock of a program that is gone; raises InputError if it runs, or if that cannot be checked."""
  try:
    text = path.read_text(encoding="utf-8")
  except FileNotFoundError:
    return  # released in the meantime
  try:
    content = json.loads(text)
    host, pid, since = content["host"], int(content["pid"]), content.get("since", "some time")
  except (ValueError, KeyError, TypeError, AttributeError):
    if time.time() - path.stat().st_mtime > 10:  # cut short by a machine that went down, not just being written
      _take_away(path, text)
      return
    raise InputError(f"{path.parent} is in use by a program that has just begun; choose another folder") from None
  if host == socket.gethostname() and not _lives(pid, content.get("born")):
    _take_away(path, text)
    return
  there = "" if host == socket.gethostname() else f"; if {host} does not run it any more, delete {path}"
  raise InputError(f"{path.parent} is in use by process {pid} on {host} since {since}; wait for it, stop it, or choose "
                   f"another folder{there}")


def _take_away(path, text):
  """Removes a lock file if it still holds that text, and not the lock of a faster program."""
  aside = path.with_name(f".{NAME}.{os.getpid()}")
  with contextlib.suppress(FileNotFoundError):
    os.replace(path, aside)
    if aside.read_text(encoding="utf-8") != text:
      with contextlib.suppress(FileExistsError):
        os.link(aside, path)
    aside.unlink()


def _lives(pid, born):
  try:
    os.kill(pid, 0)
  except ProcessLookupError:
    return False
  except (PermissionError, OverflowError, OSError):
    return True
  return born is None or _born(pid) in (None, born)  # another program may have the number now


def _born(pid):
  """Start time of a process in the kernel's ticks, from /proc: together with its number it identifies the process."""
  try:
    return int(pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19])
  except (OSError, ValueError, IndexError):
    return None
