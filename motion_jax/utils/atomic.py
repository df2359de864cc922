"""Files and folders that are written completely or not at all."""
import contextlib
import functools
import os
import pathlib
import shutil
import tempfile

from motion_jax.utils import stopping


@contextlib.contextmanager
def atomic_path(path):
  """Yields a temporary path beside `path`, which replaces it when the block succeeds and is removed otherwise.

  The suffix is kept, for writers that check it. Raises an error that names the path if it cannot be written.
  """
  path = pathlib.Path(path)
  try:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
  except OSError as error:
    raise OSError(f"cannot write {path}: {error.strerror or error}; choose a folder that you may write to") from error
  os.close(handle)
  vanish = functools.partial(pathlib.Path(name).unlink, missing_ok=True)
  with stopping.undone_by(vanish):
    try:
      yield pathlib.Path(name)
      _flush(name)
      os.chmod(name, 0o644)  # mkstemp's 0600 would keep the file from other users
      os.replace(name, path)
    finally:
      vanish()


def _flush(path):
  """Has a file's bytes on the disk, so that its new name never stands for an empty file after a power failure."""
  handle = os.open(path, os.O_RDONLY)
  try:
    os.fsync(handle)
  finally:
    os.close(handle)


def remove_strays(folder, names):
  """Removes temporary files that `atomic_path` left for these names in a folder when a program was killed."""
  for name in names:
    path = pathlib.Path(name)
    for stray in (pathlib.Path(folder) / path).parent.glob(f".{path.stem}-{'[a-z0-9_]' * 8}{path.suffix}"):
      stray.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path):
  """Yields a temporary folder beside `path`, which replaces it when the block succeeds and is removed otherwise.

  A folder at path is deleted: check before. Raises an error that names the path if it cannot be written.
  """
  path = pathlib.Path(path).absolute()
  try:
    path.parent.mkdir(parents=True, exist_ok=True)
    folder = pathlib.Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
  except OSError as error:
    raise OSError(f"cannot write {path}: {error.strerror or error}; choose a folder that you may write to") from error
  old = folder.with_name(folder.name + "-old")

  def vanish():
    if old.exists() and not path.exists():  # stopped between the two renamings
      old.replace(path)
    for temporary in (folder, old):
      if temporary.exists():
        shutil.rmtree(temporary)

  with stopping.undone_by(vanish):
    try:
      yield folder
      folder.chmod(0o755)  # mkdtemp's 0700 would keep it from other users
      if path.exists():
        path.replace(old)
      folder.replace(path)
    finally:
      with contextlib.suppress(OSError):
        vanish()
