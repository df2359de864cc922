"""Clips as plain arrays: .npz with all that is known of a motion, .npy with its joints; and the way back."""
import json
import pathlib
import zipfile

import numpy as np

from motion_jax.data.bvh import read_bvh
from motion_jax.data.capture import to_clip
from motion_jax.data.clip import Caption, Clip, atomic_path
from motion_jax.motion.features import LAYOUTS, get_layout, layout_for, to_joints
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS

LOADABLE = (".npz", ".npy", ".bvh")


def npz(clip, path) -> pathlib.Path:
  """Writes joints (T, J, 3), features if the clip has any, fps, and as strings skeleton, prompt, captions and meta.

  Only plain arrays and JSON: `np.load(path, allow_pickle=False)` reads every key.
  """
  path = pathlib.Path(path)
  arrays = {"joints": np.asarray(clip.joints, np.float32), "fps": np.float64(clip.fps),
            "skeleton": np.array(clip.skeleton.name), "joint_names": np.array(clip.skeleton.joints),
            "prompt": np.array(clip.captions[0].text if clip.captions else ""),
            "captions": np.array(json.dumps([[c.text, c.start, c.end] for c in clip.captions])),
            "about": np.array(json.dumps({key: getattr(clip, key) for key in ("id", "split", "source", "license")})),
            "meta": np.array(json.dumps(_plain(clip.meta)))}
  for key in ("seed", "model"):  # what a reader asks first deserves a key of its own
    if isinstance(clip.meta.get(key), str | int | np.integer):
      arrays["model_id" if key == "model" else key] = np.array(clip.meta[key])
  if clip.features is not None:
    arrays["features"] = np.asarray(clip.features, np.float32)
  with atomic_path(path) as temporary:
    np.savez_compressed(temporary, **arrays)
  return path


def npy(clip, path) -> pathlib.Path:
  """Writes joints (T, J, 3) float32 in the skeleton's unit, as HumanML3D's new_joints folder has them."""
  path = pathlib.Path(path)
  with atomic_path(path) as temporary:
    np.save(temporary, np.asarray(clip.joints, np.float32), allow_pickle=False)
  return path


def load(path, fps=None) -> Clip:
  """Reads .npz (as `npz` writes, or with a "joints" or "features" key), .npy or .bvh into a Clip.

  A .npy holds joints (T, 22, 3) or (T, 21, 3), or features (T, F) of a known layout such as HumanML3D's 263. fps
  replaces the rate that the file states (a .bvh is resampled to it); a .npy states none and gets its skeleton's.
  Raises FileNotFoundError, or ValueError for an unknown extension, a cut file, NaN, or a shape that is no motion.
  """
  path = pathlib.Path(path)
  read = {".npz": _load_npz, ".npy": _load_npy, ".bvh": _load_bvh}.get(path.suffix.lower())
  if read is None:
    raise ValueError(f"got {path.name!r}, expected a file that ends in {', '.join(LOADABLE)}")
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  if fps is not None and not fps > 0:
    raise ValueError(f"got {fps} frames per second, expected a positive number")
  try:
    return read(path, fps)
  except (zipfile.BadZipFile, EOFError, OSError) as error:
    raise ValueError(f"{path} cannot be read: {error}; it may be cut, write or download it again") from None
  except ValueError as error:
    raise error if str(path) in str(error) else ValueError(f"{path}: {error}") from None


def _load_npz(path, fps):
  with np.load(path, allow_pickle=False) as file:
    arrays = {key: file[key] for key in file.files}
  text = lambda key, default: str(arrays[key]) if key in arrays else default
  about, meta, captions = (_from_json(text(key, default)) for key, default in
                           (("about", "{}"), ("meta", "{}"), ("captions", "[]")))
  if not captions and text("prompt", ""):
    captions = [[text("prompt", ""), 0.0, 0.0]]
  skeleton = SKELETONS.get(text("skeleton", HUMANML3D.name))
  if skeleton is None:
    raise ValueError(f"got skeleton {text('skeleton', '')!r}, expected one of {', '.join(SKELETONS)}")
  features = arrays.get("features")
  if "joints" in arrays:
    joints = arrays["joints"]
    skeleton = skeleton if "skeleton" in arrays else _skeleton_of(joints)
  elif features is not None:
    joints, skeleton = _from_features(features)
  else:
    raise ValueError(f"it holds {', '.join(sorted(arrays)) or 'nothing'}, expected a key joints (T, 22, 3) or features")
  for key, name in (("seed", "seed"), ("model_id", "model")):
    if key in arrays and name not in meta:
      meta[name] = arrays[key].item()
  rate = fps or float(arrays.get("fps", skeleton.fps))
  about = {key: value for key, value in about.items() if key in ("id", "split", "source", "license")}
  return Clip(joints=joints.astype(np.float32), fps=rate, captions=tuple(Caption(*row) for row in captions),
              skeleton=skeleton, features=features, meta=meta, **({"id": path.stem} | about))


def _load_npy(path, fps):
  array = np.load(path, allow_pickle=False)
  if array.dtype.kind not in "fiu":
    raise ValueError(f"it holds {array.dtype} values, expected numbers")
  features = None
  if array.ndim == 2:
    joints, skeleton = _from_features(array)
    features = array.astype(np.float32)
  else:
    joints, skeleton = array, _skeleton_of(array)
  return Clip(joints=joints.astype(np.float32), fps=fps or skeleton.fps, id=path.stem, source=path.name,
              skeleton=skeleton, features=features)


def _load_bvh(path, fps):
  capture = read_bvh(path)
  return to_clip(capture, path, fps=fps or capture.fps)


def _skeleton_of(joints):
  for skeleton in SKELETONS.values():
    if joints.ndim == 3 and joints.shape[1:] == (skeleton.num_joints, 3):
      return skeleton
  dims = ", ".join(str(layout.dim) for layout in LAYOUTS.values())
  raise ValueError(f"got an array of shape {joints.shape}, expected joints (frames, 22, 3) or (frames, 21, 3), or "
                   f"features (frames, F) with F one of {dims}")


def _from_features(features):
  """Joints (T, J, 3) and the skeleton of a feature array (T, F) of a known width."""
  if features.ndim != 2 or not len(features):
    raise ValueError(f"got features of shape {features.shape}, expected (frames, F) with at least one frame")
  layout = get_layout(layout_for(features.shape[1]))
  bad = np.flatnonzero(~np.isfinite(features).all(1))
  if len(bad):
    raise ValueError(f"{len(bad)} of {len(features)} frames hold NaN or infinity, the first is frame {bad[0]}")
  return to_joints(features.astype(np.float32), layout), layout.skeleton


def _from_json(text):
  try:
    return json.loads(text)
  except json.JSONDecodeError as error:
    raise ValueError(f"its metadata is no JSON ({error})") from None


def _plain(value):
  """A copy that JSON can hold: arrays become lists, other objects their text."""
  if isinstance(value, dict):
    return {str(key): _plain(item) for key, item in value.items()}
  if isinstance(value, list | tuple):
    return [_plain(item) for item in value]
  if isinstance(value, np.ndarray | np.generic):
    return value.tolist()
  return value if value is None or isinstance(value, str | int | float | bool) else str(value)
