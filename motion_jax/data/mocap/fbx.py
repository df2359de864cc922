"""Animations of FBX files as motion capture, by the extra `fbx-read` (ufbx)."""
import pathlib

import numpy as np

from motion_jax.data.mocap import native
from motion_jax.data.mocap.capture import Capture, check_size, to_clip, with_rate
from motion_jax.data.mocap.gltf_motion import bone_capture, choose
from motion_jax.utils.errors import InputError


def read_fbx(path, animation=None) -> Capture:
  """An animation of an FBX file as a Capture of its bones, metres, at the file's rate.

  animation: its name or number, from 1; not needed for a file that holds one. Raises InputError without the extra, and
  for a file that cannot be read.
  """
  path = pathlib.Path(path)
  arrays = native.read("FBX", path, *([animation] if animation is not None else []), library="ufbx", extra="fbx-read",
                       advice="or convert it to .glb in Blender (File, Import, then File, Export, glTF 2.0)")
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
