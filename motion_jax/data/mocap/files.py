"""Files of motion capture by the ending of their names, and files that map their joints to ours."""
import collections
import json
import pathlib

from motion_jax.data.mocap import usd
from motion_jax.data.mocap.asf import AMC_FPS, amc_clip, read_amc
from motion_jax.data.mocap.bvh import bvh_clip, read_bvh
from motion_jax.data.mocap.capture import Capture, with_rate
from motion_jax.data.mocap.fbx import fbx_clip, read_fbx
from motion_jax.data.mocap.gltf import MOTIONS
from motion_jax.data.mocap.gltf_motion import gltf_clip, read_gltf
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json
from motion_jax.utils.numerals import named
from motion_jax.utils.text_files import read_text

READERS = {".bvh": bvh_clip, ".amc": amc_clip} | dict.fromkeys(MOTIONS, gltf_clip) | {".fbx": fbx_clip} | (
    dict.fromkeys(usd.SUFFIXES, usd.usd_clip))
CAPTURES = {".bvh": read_bvh, ".amc": read_amc} | dict.fromkeys(MOTIONS, read_gltf) | {".fbx": read_fbx} | (
    dict.fromkeys(usd.SUFFIXES, usd.read_usd))
_SEVERAL = (*MOTIONS, ".fbx", *usd.SUFFIXES)  # files that may hold several clips


def read_clip(path, name, faults=None, **options):
  """The Clip of a file of motion capture, with the options of its reader.

  faults: a list that takes (name, what is wrong) of a file that cannot be read, for which None comes back; without it
  the error is raised.
  """
  path, clip = split_clip(path)
  try:
    return READERS[path.suffix.lower()](path, **options | ({"clip": clip} if clip else {}))
  except (ValueError, OSError) as error:
    if faults is None:
      raise
    faults.append((name, str(error).removeprefix(str(path)).lstrip(":/ ")))
    return None


def read_capture(path, clip=None, fps=None) -> Capture:
  """The skeleton and the frames of a file of `CAPTURES`. clip: name or number of one of several animations; fps: its
  frame rate, replacing the one that it states."""
  ending = path.suffix.lower()
  if ending == ".amc":
    return read_amc(path, fps=fps or AMC_FPS)
  return with_rate(CAPTURES[ending](path, *([clip] if clip else [])), fps)


def split_clip(path) -> tuple[pathlib.Path, str | None]:
  """(file, name or number of a clip in it) of "walk.glb#Run"; (file, None) of any other path."""
  path = pathlib.Path(path)
  name, mark, clip = str(path).rpartition("#")
  if mark and clip and not path.exists() and pathlib.Path(name).suffix.lower() in _SEVERAL:
    return pathlib.Path(name), clip
  return path, None


def none_read(folder, faults) -> str:
  """What to say where `read_clip` could read no file of a folder."""
  name, what = faults[0]
  return f"{folder}: none of {len(faults)} files can be read; of the first, {name}: {what}" if len(faults) > 1 else (
      f"{folder}/{name}: {what}")


def read_mapping(mapping):
  """A mapping {our joint: their joint or a list of them} from a JSON file; a dict, a table's name, or None as it is."""
  if not isinstance(mapping, (str, pathlib.Path)) or (isinstance(mapping, str) and not mapping.endswith(".json")):
    return mapping
  path = pathlib.Path(mapping)
  if not path.is_file():
    raise FileNotFoundError(f"there is no mapping file {path}")
  value = read_json(path, advice="expected {our joint: their joint or a list of them}")
  pairs = json.loads(read_text(path), object_pairs_hook=list)
  twice = [joint for joint, count in collections.Counter(joint for joint, _ in pairs).items() if count > 1]
  if twice:
    raise InputError(f"{path} names {named(twice, 10)} twice, expected each of our joints once")
  text = lambda entry: isinstance(entry, str)
  names = lambda entry: text(entry) or (isinstance(entry, list) and entry and all(map(text, entry)))
  bad = [joint for joint, entry in value.items() if not names(entry)]
  if bad:
    raise InputError(f"{path}: {named(bad, 10)} should be a joint's name or a list of names")
  return {joint: entry for joint, entry in value.items() if entry != ""}  # what is not filled in is looked for
