"""Files that native libraries read, each in a process of its own: such a library can crash, hang or take all memory.

A child is a module of this folder (`fbx_child`, `usd_child`, `c3d_child`), called with FILE OUT.npz and further
arguments. It writes arrays to OUT.npz, or ends with the status `MISSING` where its library is not installed, or with
another status and a last line that says why.
"""
import pathlib
import subprocess
import tempfile

import numpy as np

from motion_jax.data.mocap import child
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install

MISSING = 3
_SECONDS = 300
_LARGEST = 1 << 28  # bytes of a file


def read(name, path, *arguments, library, extra, advice, memory=4e9) -> dict[str, np.ndarray]:
  """The arrays that a child makes of a file.

  name: of the format; the module is NAME_child. library, extra: what the child imports and the extra that installs it.
  advice: the end of each error's sentence. memory: bytes of address space, more by the file's size. Raises
  FileNotFoundError, or InputError for a missing library and a file that cannot be read.
  """
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  size = path.stat().st_size
  if size > _LARGEST:
    raise InputError(f"{path}: got {size >> 20:,} MiB, expected at most {_LARGEST >> 20}; export it without meshes, or "
                     "cut it in parts")
  with tempfile.TemporaryDirectory() as folder:
    out = pathlib.Path(folder) / "motion.npz"
    try:
      done = child.run(f"motion_jax.data.mocap.{name.lower()}_child", path.absolute(), out, *arguments,
                       seconds=_SECONDS, memory=memory + 64 * size)
    except subprocess.TimeoutExpired:
      raise InputError(f"{path}: it took more than {_SECONDS} s to read; cut it in parts, {advice}") from None
    if done.returncode == MISSING:
      raise InputError(f"{path}: {name} files are read by {library}: {pip_install(extra)}, {advice}")
    if done.returncode or not out.is_file():
      why = (done.stderr.strip().splitlines() or [f"the reader ended with {done.returncode}"])[-1]
      raise InputError(f"{path}: it cannot be read as {name} ({why[:100]}); export it again, {advice}")
    with np.load(out, allow_pickle=False) as file:
      return dict(file)
