"""Export clips to files by extension, and load files that hold a motion.

  export.save(clip, "wave.mp4")      .mp4 .gif film, .png .jpg strip of moments, .html page, .glb .usda .fbx figure,
                                     .bvh skeleton, .vrma, .csv .trc .c3d points, .amass.npz poses, .npz .npy arrays
  clip = export.load("wave.npz")
"""
import errno
import os
import pathlib
import tempfile
from collections.abc import Callable

from motion_jax.data.clip import Clip
from motion_jax.export.bvh import bvh
from motion_jax.export.character import character, check_character
from motion_jax.export.fbx import fbx, find_blender
from motion_jax.export.files import READERS, load, npy, npz
from motion_jax.export.glb import glb
from motion_jax.export.html import html, html_page
from motion_jax.export.points import c3d, csv, trc
from motion_jax.export.rates import at_rate
from motion_jax.export.rig import rig_error as _rig_error
from motion_jax.export.usd import usda
from motion_jax.export.video import frame, frames, strip, video
from motion_jax.export.vrma import vrma
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS, SNAPMOGEN
from motion_jax.motion.transfer import to_22
from motion_jax.rigs.rig import get_rig
from motion_jax.utils.plugins import Registry

_TOGETHER = (html, strip, character)  # several clips share one file
_OWN_RATE = (video, html, strip)  # a film interpolates what it draws, pictures have no rate
_ANY_FIGURE = (npz, npy, csv, trc, c3d)  # the others draw or store bodies of joints whose names they know


def amass(clip, path, pelvis_offset=(0.0, 0.0, 0.0)) -> pathlib.Path:
  """Writes the poses of SMPL-X as AMASS files hold them (`research_files.amass`)."""
  from motion_jax.export import research_files  # half of its imports are of use to these files only
  return research_files.amass(clip, path, pelvis_offset)


# {extension: writer(clip, path, **options) -> path}, and those of other packages.
WRITERS: Registry[Callable] = Registry("motion_jax.exports", {
    ".npz": npz, ".npy": npy, ".bvh": bvh, ".glb": glb, ".vrma": vrma, ".usda": usda, ".fbx": fbx, ".vrm": character,
    ".csv": csv, ".trc": trc, ".c3d": c3d, ".amass.npz": amass, ".mp4": video, ".gif": video, ".html": html,
    ".png": strip, ".jpg": strip})


def check_output(path) -> str:
  """Raises a clear error now if `save` could not write there later; returns the path."""
  path = pathlib.Path(path)
  if path.is_dir():
    raise IsADirectoryError(f"cannot write {path}: it is a folder; name a file in it, such as {path / 'motion.html'}")
  if not ending_of(path):
    raise ValueError(f"got {path.name!r}, expected a file name that ends in one of " + " ".join(WRITERS))
  if path.suffix.lower() == ".mp4":
    from motion_jax.export.video import find_ffmpeg
    find_ffmpeg()
  if path.suffix.lower() == ".fbx":
    find_blender()
  folder = path.parent
  while not folder.exists() and folder != folder.parent:
    folder = folder.parent
  try:
    if not folder.is_dir():
      raise NotADirectoryError(errno.ENOTDIR, f"{folder} is not a folder")
    with tempfile.TemporaryFile(dir=folder):  # asking the system beats reading permission bits
      pass
  except OSError as error:
    reason = error.strerror or error
    raise type(error)(f"cannot write {path}: {reason}; choose a folder that you may write to") from None
  return os.fspath(path)


def ending_of(path) -> str:
  """The longest ending of a file's name that a writer is for, such as ".amass.npz"; "" for none."""
  name = pathlib.Path(path).name.lower()
  return max((ending for ending in WRITERS if name.endswith(ending)), key=len, default="")


def save(clip, path, **options) -> list[pathlib.Path]:
  """Writes one clip, or a list of clips, by the path's extension; returns the paths written.

  Several clips share an .html page or a picture, a row each; other kinds become name_0.ext, name_1.ext, ... Options go
  to the writer (`help(motion_jax.export.video)` and so on). file: a rigged character (.glb, .gltf, .vrm) which a .glb
  or .vrm is written of, all clips in one (`character`). fps: the frame rate of a file (`export.rates`), by default the
  clip's. A file appears whole or not at all.
  """
  clips = list(clip) if isinstance(clip, list | tuple) else [clip]
  if not clips:
    raise ValueError(f"got no clip to write to {path}")
  path = pathlib.Path(check_output(path))
  ending = ending_of(path)
  rate = None if WRITERS[ending] in _OWN_RATE else options.pop("fps", None)
  if rate is not None:
    clips = [at_rate(item, rate) for item in clips]
  write = character if options.get("file") is not None else WRITERS[ending]
  if write not in _ANY_FIGURE:
    clips = [_for_rig(_with_22_joints(clip), options.get("rig")) for clip in clips]
  if len(clips) == 1:
    if isinstance(options.get("control"), list):
      options["control"] = options["control"][0]
    return [write(clips[0], path, **options)]
  if write in _TOGETHER:
    return [write(clips, path, **options)]
  digits = len(str(len(clips) - 1))
  signals = options.pop("control", None)  # one for each, or nothing
  each = [options if signals is None else options | {"control": signals[i]} for i in range(len(clips))]
  stem, kept = path.name[:-len(ending)], path.name[-len(ending):]
  return [write(item, path.with_name(f"{stem}_{i:0{digits}d}{kept}"), **each[i]) for i, item in enumerate(clips)]


def rig_error(clip) -> tuple[float, float, str]:
  """(mean, worst, joint of the worst): how far a clip's .bvh and .glb are from it, millimetres, unless exact=True."""
  return _rig_error(_with_22_joints(clip))


def page(clip) -> str:
  """The .html page of a clip, or of a list of clips, as text: for notebooks and pages of one's own."""
  return html_page([_with_22_joints(item) for item in ([clip] if isinstance(clip, Clip) else clip)])


def _for_rig(clip, rig):
  """The clip on the skeleton of a rig that has other joints than HumanML3D's 22."""
  if not isinstance(rig, str) or clip.skeleton is not HUMANML3D:
    return clip
  target = get_rig(rig)
  return clip if set(target.joints) <= set(HUMANML3D.joints) else clip.on_skeleton(SKELETONS[target.name])


def _with_22_joints(clip):
  if getattr(clip, "skeleton", None) is not SNAPMOGEN:
    return clip
  return clip.replace(joints=to_22(clip.joints), skeleton=HUMANML3D, features=None)


__all__ = ["READERS", "WRITERS", "amass", "bvh", "c3d", "character", "check_character", "check_output", "csv",
           "ending_of", "fbx", "frame", "frames", "glb", "html", "load", "npy", "npz", "page", "rig_error", "save",
           "strip", "trc", "usda", "video", "vrma"]
