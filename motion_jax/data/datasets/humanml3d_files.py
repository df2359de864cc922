"""Split files and `dataset.json` of folders in HumanML3D's layout."""
import pathlib

from motion_jax.motion.representations import get_layout, layout_for
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import npy_shape, read_json
from motion_jax.utils.numerals import shortened
from motion_jax.utils.text_files import file_stem, read_lines

MIN_FRAMES = {"humanml3d": 40, "kit": 24}


def read_ids(folder, split="all") -> list[str]:
  """The ids of a split file; without an all.txt, those of all the other split files."""
  folder = pathlib.Path(folder)
  path = folder / f"{split}.txt"
  if path.is_file():
    return [file_stem(name, f"{path} line {number}") for number, line in enumerate(read_lines(path), 1)
            for name in line.split()]
  parts = [name for name in ("train", "val", "test") if (folder / f"{name}.txt").is_file()]
  if split != "all" or not parts:
    raise FileNotFoundError(f"{folder} has no {split}.txt; expected one id per line in it")
  return [name for part in parts for name in read_ids(folder, part)]


def dataset_info(folder) -> dict:
  """The entries of dataset.json, with defaults for layout, skeleton, fps and mode where they are missing."""
  folder = pathlib.Path(folder)
  path = folder / "dataset.json"
  info = read_json(path, advice="restore it, or remove it where the folder is HumanML3D's or KIT-ML's own") if (
      path.is_file()) else {}
  if "layout" not in info:
    sample = next(iter(sorted((folder / "new_joint_vecs").glob("*.npy"))), None)
    if sample is None:
      raise FileNotFoundError(f"{folder} has no new_joint_vecs/*.npy; expected a HumanML3D or KIT-ML folder")
    info["layout"] = layout_for((npy_shape(sample) or (0,))[-1]).name
  if not isinstance(info["layout"], str):
    raise InputError(f"{path}: got layout {str(info['layout'])[:60]!r}, expected a name such as 'full'")
  skeleton = get_layout(info["layout"]).skeleton
  info = {"skeleton": skeleton.name, "fps": skeleton.fps, "mode": "benchmark", "source": folder.name, "license": "",
          "clips": {}} | info
  _check_info(info, path)
  return info


def _check_info(info, path):
  """Raises InputError for entries of dataset.json of a wrong type."""
  for key, kind, expected in (("source", str, "text"), ("license", str, "text"), ("mode", str, "text"),
                            ("clips", dict, "an object")):
    if not isinstance(info[key], kind):
      raise InputError(f"{path}: got {key} {str(info[key])[:60]!r}, expected {expected}")
  if isinstance(info["fps"], bool) or not isinstance(info["fps"], int | float) or not 0 < info["fps"] <= 1000:
    raise InputError(f"{path}: got fps {str(info['fps'])[:60]!r}, expected the frames of a second")
  strange = next((name for name, origin in info["clips"].items() if not isinstance(origin, dict)), None)
  if strange is not None:
    raise InputError(f"{path}: clip {shortened(strange)!r} holds no object with source and license")
