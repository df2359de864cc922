"""Files and folders that are written completely or not at all."""
import contextlib
import errno
import functools
import os
import pathlib
import re
import shutil
import tempfile
import time

from motion_jax.utils import stopping

try:
  import fcntl
except ImportError:  # Windows: what killed programs leave behind stays there
  fcntl = None

_PART = "-part-"  # in the name of what is being written: .walk-part-a1b2c3d4.npz becomes walk.npz
_OURS = re.compile(r"\.(.+)-part-[a-z0-9_]{8}(-old|\.[^.]*)?")
_YOUNG = 60.0     # seconds in which another program may not have locked its file yet
# What libraries that write say of a full disk: numpy how many bytes it wanted to write and how many it did.
_FULL = re.compile(r"\d+ requested and \d+ written|.*(No space left|Disk quota exceeded|File too large).*", re.DOTALL)


@contextlib.contextmanager
def _naming_a_full_disk(path):
  """Raises OSError with ENOSPC for a full disk, whatever a library without errno raises."""
  try:
    yield
  except Exception as error:
    if getattr(error, "errno", None) is not None or not _FULL.fullmatch(str(error)):
      raise
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error


@contextlib.contextmanager
def atomic_path(path):
  """Yields a temporary path beside `path`, which replaces it when the block succeeds and is removed otherwise.

  The suffix is kept, for writers that check it. Raises an error that names the path if it cannot be written. What a
  program that was killed has left for this path is removed.
  """
  path = pathlib.Path(path)
  with _naming(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_dead(path.absolute().parent, path.stem)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}{_PART}", suffix=path.suffix, dir=path.parent)
  vanish = functools.partial(pathlib.Path(name).unlink, missing_ok=True)
  with stopping.undone_by(vanish), _held(handle):
    try:
      with _naming_a_full_disk(path):
        yield pathlib.Path(name)
        _flush(name)
      os.chmod(name, 0o644)  # mkstemp's 0600 would keep the file from other users
      os.replace(name, path)
    finally:
      vanish()


@contextlib.contextmanager
def atomic_folder(path):
  """Yields a temporary folder beside `path`, which replaces it when the block succeeds and is removed otherwise.

  A folder at path is deleted: check before. Raises an error that names the path if it cannot be written.
  """
  path = pathlib.Path(path).absolute()
  with _naming(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_dead(path.parent, path.name)
    folder = pathlib.Path(tempfile.mkdtemp(prefix=f".{path.name}{_PART}", dir=path.parent))
  old = folder.with_name(folder.name + "-old")

  def vanish():
    if old.exists() and not path.exists():  # stopped between the two renamings
      old.replace(path)
    for temporary in (folder, old):
      if temporary.exists():
        shutil.rmtree(temporary)

  with stopping.undone_by(vanish), _held(os.open(folder, os.O_RDONLY) if fcntl else None):
    try:
      with _naming_a_full_disk(path):
        yield folder
      folder.chmod(0o755)  # mkdtemp's 0700 would keep it from other users
      if path.exists():
        path.replace(old)
      folder.replace(path)
    finally:
      with contextlib.suppress(OSError):
        vanish()


def remove_strays(folder, names):
  """Removes temporary files that `atomic_path` left for these names in a folder when a program was killed.

  Another program that writes these files now would lose them: the folder must be this program's own.
  """
  for name in names:
    path = pathlib.Path(folder) / name
    for stray in _parts(path.parent).get(path.stem, ()):
      stray.unlink(missing_ok=True)


@contextlib.contextmanager
def _naming(path):
  try:
    yield
  except OSError as error:
    raise OSError(f"cannot write {path}: {error.strerror or error}; choose a folder that you may write to") from error


def _flush(path):
  """Has a file's bytes on the disk, so that its new name never stands for an empty file after a power failure."""
  handle = os.open(path, os.O_RDONLY)
  try:
    os.fsync(handle)
  finally:
    os.close(handle)


# --- what killed programs have left ------------------------------------------------------------------------------


@contextlib.contextmanager
def _held(handle):
  """Holds a lock while the block runs, which the system gives back if the program is killed."""
  try:
    if fcntl is None and handle is not None:
      os.close(handle)  # an open file can be neither replaced nor removed there
    elif handle is not None:
      with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    yield
  finally:
    if fcntl is not None and handle is not None:
      os.close(handle)


def _parts(folder):
  """{stem: [paths]} of what is being written in a folder, or was by programs that have been killed."""
  parts = {}
  with contextlib.suppress(OSError), os.scandir(folder) as entries:
    for entry in entries:
      if match := _OURS.fullmatch(entry.name):
        parts.setdefault(match[1], []).append(pathlib.Path(entry.path))
  return parts


_parts_at_first = functools.lru_cache(1000)(_parts)  # thousands of files may be written into one folder


def _remove_dead(folder, stem):
  """Removes what nothing writes to any more: it is not young, and its lock is free."""
  if fcntl is None:
    return
  for part in _parts_at_first(folder).pop(stem, ()):
    with contextlib.suppress(OSError):
      handle = os.open(part, os.O_RDONLY)
      try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if time.time() - os.fstat(handle).st_mtime > _YOUNG:
          _remove(part, folder / stem)
      finally:
        os.close(handle)


def _remove(part, path):
  if not part.is_dir():
    part.unlink()
  elif part.name.endswith("-old") and not path.exists():
    part.replace(path)  # the program was killed between the two renamings of `atomic_folder`
  else:
    shutil.rmtree(part)
