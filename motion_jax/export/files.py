"""Write and read clips as plain arrays: .npz with joints and all metadata, .npy with joints only."""
import contextlib
import json
import pathlib
import shlex
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.mocap.capture import to_clip
from motion_jax.data.mocap.files import CAPTURES, read_capture, read_mapping, split_clip
from motion_jax.export.points import POINTS, Points, load_points
from motion_jax.motion import plausibility
from motion_jax.motion.representations import get_layout, layout_for, to_joints
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS
from motion_jax.rigs.joint_arrays import pick_joints
from motion_jax.rigs.joint_maps import skeleton_of
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.format_versions import KEY, check_version
from motion_jax.utils.input_files import PickledError, load_npy, load_npz, npz_names, parse_json
from motion_jax.utils.json_values import plain
from motion_jax.utils.plugins import Registry

_HOLOSOMA_FPS, _KIMODO_FPS = 30.0, 30.0
_OWN_AXIS = ".bvh", ".amc"  # their readers derive the upward axis and say so


def npz(clip, path) -> pathlib.Path:
  """Writes joints (T, J, 3), features if the clip has any, fps, and as strings skeleton, prompt, captions and meta.

  Only plain arrays and JSON: `np.load(path, allow_pickle=False)` reads every key.
  """
  path = pathlib.Path(path)
  arrays = {KEY: np.int64(1), "joints": np.asarray(clip.joints, np.float32), "fps": np.float64(clip.fps),
            "skeleton": np.array(clip.skeleton.name), "joint_names": np.array(clip.skeleton.joints),
            "prompt": np.array(clip.captions[0].text if clip.captions else ""),
            "captions": np.array(json.dumps([[c.text, c.start, c.end] for c in clip.captions])),
            "about": np.array(json.dumps({key: getattr(clip, key) for key in ("id", "split", "source", "license")})),
            "meta": np.array(json.dumps(plain(clip.meta)))}
  for key in ("seed", "model"):  # frequently needed, so they are keys of their own
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


def load(path, fps=None, unit="auto", up=None, mapping=None, check=True) -> Clip:
  """Reads .npz (as `npz` writes, AMASS', Kimodo's, a Unitree G1's, or with a "joints" or "features" key), .npy, .bvh,
  .amc (its .asf beside it), .csv (joints by name, or a Unitree G1), .trc, .c3d, or the animation of a .glb, .gltf,
  .vrm, .vrma, .fbx, .usd, .usda or .usdc; of several, walk.glb#NAME or walk.glb#2 is one of them.

  A .npy holds joints (T, 22, 3) or (T, 21, 3), or features (T, F) of a known layout such as HumanML3D's 263. fps: frame
  rate of the file, replacing the one that it states; by default a .npy gets its skeleton's rate, an .amc 120. Nothing
  is resampled. unit: of joints, "m", "cm", "mm", "in" or "ft"; "auto" derives it from the bones. up: the file's upward
  axis, "y", "z" or "x"; by default y, for .bvh and .amc derived from the pose, for .c3d z. mapping: {our joint: their
  joint} of a file whose joint names are not known (`rigs.map_joints`), as a dict or a JSON file. check=False also reads
  implausible skeletons.

  Raises FileNotFoundError, or ValueError for an unknown extension, a cut file, NaN, a shape that is no motion, or an
  implausible skeleton (`motion.plausibility`), which is only a warning for a motion that a model generated.
  """
  path, clip_name = split_clip(path)
  read = _reader(path)
  plausibility.check_rate(fps, str(path))
  read_as = lambda up: read(path, fps, unit, up, read_mapping(mapping), **({"clip": clip_name} if clip_name else {}))
  try:
    with np.errstate(over="ignore", invalid="ignore"):  # infinite numbers are reported below
      clip = read_as(up)
  except ValueError as error:
    raise error if str(path) in str(error) else InputError(f"{path}: {error}") from None
  if check and (model := clip.meta.get("model")) and np.isfinite(clip.joints).all():
    # Generated motion is read in any case: a barely trained model samples implausible skeletons.
    if fault := plausibility.fault(clip.joints, clip.skeleton, clip.fps, str(path)):
      warnings.warn(f"{fault}; {model} generated it so, as models do that were trained too little", stacklevel=2)
  elif check:
    plausibility.check(clip.joints, clip.skeleton, clip.fps, str(path))
    if up is None and path.suffix.lower() not in _OWN_AXIS and plausibility.upward_axis(
        clip.joints, clip.skeleton) not in ("y", ""):
      _tell_upward_axis(read_as, path)
  return clip


def named_joints(path) -> tuple[Sequence[str], np.ndarray, Sequence[int] | None]:
  """(names, positions (T, N, 3), parents) of the joints of any motion file, as they are in it; parents is None for
  points without a tree."""
  path, clip_name = split_clip(path)
  _reader(path)
  ending = path.suffix.lower()
  if ending in CAPTURES:
    capture = read_capture(path, clip_name)
    return capture.names, capture.positions, capture.parents
  if ending in POINTS and isinstance(points := POINTS[ending](path), Points):
    return points.names, points.positions, None
  clip = load(path, check=False)
  return clip.skeleton.joints, clip.joints, clip.skeleton.parents


def _reader(path):
  """The reader of a file. Raises an OSError or ValueError for a path that is none of a motion file."""
  if path.suffix.lower() in (".pkl", ".pickle", ".pt", ".pth"):
    from motion_jax.export import research_files
    raise InputError(research_files.pickled(path))
  if path.is_dir():
    raise IsADirectoryError(f"{path} is a folder, expected a motion file; name one in it")
  if path.suffix.lower() == ".usdz":
    raise InputError(f"got {path.name!r}, a package of USD files: unzip it and name the .usd, .usda or .usdc in it")
  read = READERS.get(path.suffix.lower())
  if read is None:
    raise ValueError(f"got {path.name!r}, expected a file that ends in {', '.join(READERS)}")
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  return read


def _tell_upward_axis(read_as, path):
  """Warns about a body that lies along an axis, with the value of `up` by which it stands."""
  for up in ("y", "z", "x", "-y", "-z", "-x"):
    with contextlib.suppress(ValueError), warnings.catch_warnings(action="ignore"):
      clip = read_as(up)
      if plausibility.upward_axis(clip.joints, clip.skeleton) == "y":
        break
  else:
    return
  flag = f"--up={up}" if up.startswith("-") else f"--up {up}"
  warnings.warn(f"{path}: the body lies, or the file's upward axis is {up.removeprefix('-')}; {flag} (up={up!r}) "
                "reads it so that it stands", stacklevel=3)


def _load_npz(path, fps, unit, up, mapping):
  arrays = load_npz(path, (KEY, "joints", "features", "posed_joints", "fps", "seed"),
                    ("skeleton", "prompt", "captions", "about", "meta", "model_id"))
  if KEY in arrays:
    check_version(_number(arrays, KEY), str(path))
  if "posed_joints" in arrays and "joints" not in arrays:
    arrays["joints"] = arrays.pop("posed_joints")
    arrays.setdefault("fps", np.float64(_KIMODO_FPS))
  if "joints" not in arrays and "features" not in arrays:
    from motion_jax.export import research_files  # half of its imports are of use to these files only
    keys = npz_names(path)
    if research_files.is_amass(keys):
      joints, rate = research_files.read_amass(path, up, fps)
      return Clip(joints=joints.astype(np.float32), fps=fps or rate, id=path.stem, source=path.name)
    if "global_joint_positions" in keys:  # holosoma's: a person's joints in a robot's axes
      joints = load_npz(path, ("global_joint_positions",))["global_joint_positions"]
      joints, skeleton = pick_joints(np.asarray(joints, np.float64)[..., [1, 2, 0]], str(path))
      return Clip(joints=joints.astype(np.float32), fps=fps or _HOLOSOMA_FPS, id=path.stem, source=path.name,
                  skeleton=skeleton)
    if {"qpos", "dof_pos", "joint_pos"} & set(keys):
      return _of_g1(path, fps)
    raise InputError(f"{path} holds {', '.join(keys[:8]) or 'nothing'}, expected a key joints (T, 22, 3), features, "
                     "posed_joints (Kimodo) or poses and trans (AMASS)")
  about, meta, rows = (_from_json(arrays, key, kind) for key, kind in (("about", dict), ("meta", dict),
                                                                       ("captions", list)))
  prompt = _text(arrays, "prompt")
  captions = [_caption(row) for row in rows] or ([Caption(prompt)] if prompt else [])
  name = _text(arrays, "skeleton") or HUMANML3D.name
  if name not in SKELETONS:
    raise InputError(f"got skeleton {name[:60]!r}, expected one of {', '.join(SKELETONS)}")
  skeleton, features = SKELETONS[name], arrays.get("features")
  if "joints" in arrays:
    joints = arrays["joints"]
    if "skeleton" not in arrays:
      joints, skeleton = pick_joints(joints, str(path))
    if features is not None and (features.ndim != 2 or not np.isfinite(features).all()):
      raise InputError(f"got features of shape {features.shape}, expected (frames, F), all finite; write it again")
    joints = plausibility.to_unit(joints, skeleton, unit, up or "y", str(path))
  else:
    joints, skeleton = _from_features(features)
  if "model_id" in arrays:
    meta.setdefault("model", _text(arrays, "model_id"))
  if "seed" in arrays:
    meta.setdefault("seed", _number(arrays, "seed"))
  rate = fps or (_number(arrays, "fps") if "fps" in arrays else skeleton.fps)
  plausibility.check_rate(rate, str(path))
  about = {key: value for key, value in about.items() if key in ("id", "split", "source", "license")}
  if not all(isinstance(value, str) for value in about.values()):
    raise InputError("its key about holds no texts; write the file again")
  return Clip(joints=joints.astype(np.float32), fps=rate, captions=tuple(captions), skeleton=skeleton,
              features=features, meta=meta, **({"id": path.stem} | about))


def _of_g1(path, fps):
  """The person's joints of a Unitree G1's motion with 29 or 23 joints."""
  from motion_jax import robots
  from motion_jax.robots.formats import side_car
  robot = robots.load("g1")
  if robots.is_robots(path) and side_car(path).get("robot", "g1") == "g1":
    for joints in (29, 23):
      with contextlib.suppress(InputError):
        return robots.read_npz(path, robot.with_joints(joints), fps).to_clip()
  raise InputError(f"{path} holds a robot's motion, and not of a Unitree G1; motion-jax retarget "
                   f"{shlex.quote(str(path))} --robot ROBOT brings it back to a person's joints")


def _text(arrays, key) -> str:
  """A string that an array holds, "" where there is none."""
  array = arrays.get(key, np.array(""))
  if array.size != 1:
    raise InputError(f"its key {key} holds {array.size} texts, expected one; write the file again")
  value = array.item()
  return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _number(arrays, key):
  if arrays[key].size != 1:
    raise InputError(f"its key {key} holds {arrays[key].size} numbers, expected one; write the file again")
  return arrays[key].item()


def _from_json(arrays, key, kind):
  text = _text(arrays, key)
  value = parse_json(text, f"its key {key},") if text else kind()
  if not isinstance(value, kind):
    raise InputError(f"its key {key} holds JSON of another kind than {kind.__name__}; write the file again")
  return value


def _caption(row):
  number = lambda value: isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < np.inf
  if not isinstance(row, list) or len(row) != 3 or not isinstance(row[0], str) or not all(map(number, row[1:])):
    raise InputError(f"got the caption {str(row)[:60]}, expected [text, start, end] with seconds; write the file again")
  return Caption(*row)


def _load_npy(path, fps, unit, up, mapping):
  try:
    array = load_npy(path)
  except PickledError:
    from motion_jax.export import research_files
    raise InputError(research_files.pickled(path)) from None
  features = None
  if array.ndim == 2:
    joints, skeleton = _from_features(array)
    features = array.astype(np.float32)
  else:
    joints, skeleton = pick_joints(array, str(path))
    joints = plausibility.to_unit(joints, skeleton, unit, up or "y", str(path))
  return Clip(joints=joints.astype(np.float32), fps=fps or skeleton.fps, id=path.stem, source=path.name,
              skeleton=skeleton, features=features)


def _load_capture(path, fps, unit, up, mapping, clip=None):
  """The frames of a capture as they are, on the skeleton that its names are of."""
  capture = read_capture(path, clip, fps)
  skeleton = HUMANML3D if mapping else skeleton_of(capture.names)
  up = up or ("auto" if path.suffix.lower() in _OWN_AXIS else "y")
  return to_clip(capture, path, mapping, capture.fps, unit, up, skeleton=skeleton)


def _from_features(features):
  """Joints (T, J, 3) and the skeleton of a feature array (T, F) of a known width."""
  if features.ndim != 2 or not len(features):
    raise ValueError(f"got features of shape {features.shape}, expected (frames, F) with at least one frame")
  layout = get_layout(layout_for(features.shape[1]))
  bad = np.flatnonzero(~np.isfinite(features).all(1))
  if len(bad):
    raise ValueError(f"{len(bad)} of {len(features)} frames hold NaN or infinity, the first is frame {bad[0]}")
  joints = to_joints(features.astype(np.float32), layout)
  if _turns_are_off(features, layout) or plausibility.fault(joints, layout.skeleton):
    normalised = abs(features.mean()) < 1 and 1 / 3 < features.std() < 3
    raise InputError(f"its {features.shape[1]} features a frame make no person's joints; "
                     + ("these look like normalised features: x * Std + Mean first, with the Mean.npy and Std.npy that "
                        "they were normalised by" if normalised else
                        f"are they of another representation than {layout.name!r}, or of another unit?"))
  return joints, layout.skeleton


def _turns_are_off(features, layout):
  """Whether the rotations among features are far from any: columns of a matrix, which are one long."""
  turns = [features[:, part].reshape(-1, 3) for name, part in layout.blocks.items() if "rotation" in name]
  return bool(turns) and float(np.median(np.abs(np.linalg.norm(np.concatenate(turns), axis=-1) - 1))) > 0.2


# {extension: reader(path, fps, unit, up, mapping) -> Clip}, and those of other packages; the arguments are `load`'s.
READERS: Registry[Callable] = Registry("motion_jax.imports", {
    ".npz": _load_npz, ".npy": _load_npy} | dict.fromkeys(CAPTURES, _load_capture) | dict.fromkeys(POINTS, load_points))
