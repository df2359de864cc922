"""Animations of FBX files as motion capture, by the extra `fbx-read` (ufbx)."""
import pathlib
import subprocess
import tempfile

import numpy as np

from motion_jax.data.mocap.capture import Capture, check_size, to_clip, with_rate
from motion_jax.data.mocap.gltf_motion import bone_capture, choose
from motion_jax.utils import child
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install

_LARGEST = 1 << 28  # bytes
_SECONDS = 300
_MEMORY = 4e9       # bytes of address space, more by the file's size
_MISSING = 3        # the child's exit status without ufbx
_CONVERT = "or convert it to .glb in Blender (File, Import, then File, Export, glTF 2.0)"


def read_fbx(path, animation=None) -> Capture:
  """An animation of an FBX file as a Capture of its bones, metres, at the file's rate.

  animation: its name or number, from 1; not needed for a file that holds one. Raises InputError without the extra, and
  for a file that cannot be read.
  """
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  if path.stat().st_size > _LARGEST:
    raise InputError(f"{path}: got {path.stat().st_size >> 20:,} MiB, expected at most {_LARGEST >> 20}; export the "
                     "armature without its mesh")
  with tempfile.TemporaryDirectory() as folder:
    out = pathlib.Path(folder) / "motion.npz"
    wanted = [animation] if animation is not None else []
    try:
      done = child.run("motion_jax.data.mocap.fbx_child", path.absolute(), out, *wanted, seconds=_SECONDS,
                       memory=_MEMORY + 64 * path.stat().st_size)
    except subprocess.TimeoutExpired:
      raise InputError(f"{path}: it took more than {_SECONDS} s to read; cut it in parts, {_CONVERT}") from None
    if done.returncode == _MISSING:
      raise InputError(f"{path}: .fbx files are read by ufbx: {pip_install('fbx-read')}, {_CONVERT}")
    if done.returncode or not out.is_file():
      why = (done.stderr.strip().splitlines() or [f"the reader ended with {done.returncode}"])[-1]
      raise InputError(f"{path}: it cannot be read as FBX ({why[:100]}); export it again, {_CONVERT}")
    with np.load(out, allow_pickle=False) as file:
      arrays = dict(file)
  if "moving" not in arrays:
    choose(arrays["animations"].tolist(), animation, path)  # raises
    raise InputError(f"{path}: several of its animations have that name; choose one by its number, behind #")
  names, still, moving = arrays["names"].tolist(), arrays["still"], arrays["moving"]
  check_size(path, *moving.shape[:2])
  parents, kept = arrays["parents"].tolist(), np.flatnonzero(arrays["kept"]).tolist()
  return bone_capture(path, names, parents, kept, [still[:, part] for part in _PARTS],
                      [moving[..., part] for part in _PARTS], float(arrays["rate"]))


def fbx_clip(path, mapping=None, fps=20.0, source_fps=None, clip=None, **options):
  """An animation of an FBX file as a Clip of 22 joints: `read_fbx` and `capture.to_clip`, whose options these are."""
  return to_clip(with_rate(read_fbx(path, clip), source_fps), path, mapping, fps, **{"up": "y"} | options)


_PARTS = slice(0, 3), slice(3, 7), slice(7, 10)
