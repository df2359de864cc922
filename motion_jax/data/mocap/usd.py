"""Skeletal animation of USD files (.usd, .usda, .usdc) as motion capture, by the extra `usd` (usd-core).

Source: openusd.org, UsdSkel schemas.
"""
import pathlib
import warnings

import numpy as np

from motion_jax.data.mocap import native
from motion_jax.data.mocap.capture import MOST, Capture, check_size, to_clip, with_rate
from motion_jax.data.mocap.gltf_motion import choose, world_capture
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named

SUFFIXES = ".usd", ".usda", ".usdc"
_ADVICE = "or export a .glb from the program that made it"
_FLATTEN = "write it into one file first (usdcat --flatten, or Blender's import and export)"
_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # faces -y -> faces +z


def read_usd(path, animation=None) -> Capture:
  """A SkelAnimation of a USD file as a Capture of its skeleton's joints, y up, in the unit that the stage states.

  animation: its name or number, from 1; not needed for a file that holds one. Other files that the file refers to are
  not read, with a warning. Raises FileNotFoundError, or InputError without the extra, for a file that cannot be read,
  and for one without a skeleton or an animation.
  """
  path = pathlib.Path(path)
  arrays = native.read("USD", path, MOST, *([animation] if animation is not None else []), library="usd-core",
                       extra="usd", advice=_ADVICE)
  outside = arrays["outside"].tolist()
  needs = f"it refers to {named(outside, 3)}, and only the file itself is read: {_FLATTEN}" if outside else ""
  names, num_skeletons = arrays["animations"].tolist(), int(arrays["skeletons"])
  if not num_skeletons or not names:
    what = "no skeleton" if not num_skeletons else "a skeleton and no animation of it"
    raise InputError(f"{path}: it holds {what}, expected a Skeleton and a SkelAnimation; " + (
        needs or "export it with its armature and animation"))
  if outside:
    warnings.warn(f"{path}: {needs}", stacklevel=2)
  if "frames" not in arrays:
    choose(names, animation, path)  # raises
    raise InputError(f"{path}: several of its animations have that name; choose one by its number, behind #")
  check_size(path, int(arrays["frames"]), int(arrays["joints"]))
  still, moving, parents = arrays["rest"], arrays["matrices"], arrays["parents"].tolist()
  if str(arrays["up"]) == "Z":
    still, moving = _Z_UP @ still, _Z_UP @ moving
  unit = float(arrays["unit"])  # 0: not stated
  return world_capture(path, arrays["names"].tolist(), parents, still, moving, float(arrays["rate"]), unit or None,
                       "metres" if unit else "centimetres")


def usd_clip(path, mapping=None, fps=20.0, source_fps=None, clip=None, **options):
  """A SkelAnimation of a USD file as a Clip of 22 joints: `read_usd` and `capture.to_clip`, whose options these are."""
  return to_clip(with_rate(read_usd(path, clip), source_fps), path, mapping, fps, **{"up": "y"} | options)
