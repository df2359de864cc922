"""A run folder: config.json, Mean.npy and Std.npy, params.safetensors, metrics.jsonl, checkpoints/.

What is needed to use a model is in plain files that any tool reads; what is needed to resume training is in
checkpoints/, see `saver`.
"""
import json
import pathlib

import flax
import ml_collections
import numpy as np
from safetensors.numpy import save_file

from motion_jax.nets.network_sizes import check_sizes
from motion_jax.training.distributed import by_first
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.format_versions import KEY, check_version
from motion_jax.utils.input_files import load_safetensors, read_json

CONFIG, PARAMS = "config.json", "params.safetensors"
CRITIC = "critic"  # the parameters of a critic beside those of a network, which are left out when a run is loaded
RAW = "raw.safetensors"        # the last weights as they are, where PARAMS holds their average
LAST = "last.safetensors"      # the weights of the last save, where PARAMS holds the best ones by validation
FROZEN = "frozen.safetensors"  # frozen parts of a stage: the denoiser's tokenizer
LENGTHS = "captions.json"      # [caption, usual frames] rows of the training data
DATA = "data.json"             # digests of the training data
TEXT = "text.json"             # name and fingerprint of the text encoder that a denoiser was trained on
ENCODER = "text_encoder"       # a copy of that encoder, if it is small and from a folder


def is_fresh(workdir):
  """Whether a run folder holds no training that could be lost, as before the first save."""
  folder = pathlib.Path(workdir)
  saved = [path for path in folder.glob("checkpoints/*") if path.name.isdigit()]
  return not saved and not (folder / PARAMS).exists()


@by_first
def save_params(folder, params, dtype=np.float32, name=PARAMS):
  """Parameters as one flat safetensors file, keys joined by "/"."""
  flat = flax.traverse_util.flatten_dict(flax.core.unfreeze(params), sep="/")
  with atomic_path(pathlib.Path(folder) / name) as path:
    # In order: safetensors writes the bytes of a transposed view as they lie in memory.
    save_file({key: np.asarray(value, dtype, order="C") for key, value in flat.items()}, path)


def load_params(folder, like=None, name=PARAMS):
  """Reads what save_params wrote, as float32 arrays. With `like` (arrays or shapes) every name and shape must agree."""
  path = pathlib.Path(folder) / name
  if not path.is_file():
    raise FileNotFoundError(f"{folder} has no {name}; a run folder holds {CONFIG}, Mean.npy, Std.npy and {name}")
  flat = load_safetensors(path, advice="it is no whole safetensors file: copy it again from the run that wrote it")
  with reading(path, "the names in it do not make a tree: copy it again from the run that wrote it"):
    params = flax.traverse_util.unflatten_dict(flat, sep="/")
  if like is not None:
    check_fits(params, like, f"{path} does not fit its config")
  return params


def check_fits(params, like, what):
  """Raises ValueError, begun by `what`, unless names and shapes of params are those of `like` (arrays or shapes)."""
  flat, expected = (flax.traverse_util.flatten_dict(flax.core.unfreeze(tree), sep="/") for tree in (params, like))
  wrong = [f"{key}: {flat[key].shape if key in flat else 'missing'} instead of "
           f"{expected[key].shape if key in expected else 'nothing'}"
           for key in sorted(flat.keys() | expected.keys())
           if key not in flat or key not in expected or flat[key].shape != expected[key].shape]
  if wrong:
    shared = len(flat.keys() & expected.keys())
    hint = ("" if shared == len(expected) == len(flat) else  # of another size, which the shapes show
            f"; it holds {len(flat)} arrays, of which {shared} are among the {len(expected)} of this network: the "
            "weights of another network, method or version")
    raise InputError(f"{what}: " + "; ".join(wrong[:3]) + (f" and {len(wrong) - 3} more" if len(wrong) > 3 else "") +
                     hint)


def save_text(folder, name, text):
  """Writes a file of a run folder, text or bytes, completely or not at all."""
  with atomic_path(pathlib.Path(folder) / name) as path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())


def load_json(folder, name, kind=dict):
  """A JSON file of a run folder; raises FileNotFoundError or InputError that say what to do."""
  path = pathlib.Path(folder) / name
  if not path.is_file():
    raise FileNotFoundError(f"{folder} has no {name}; expected a run folder, written by motion-jax train")
  return read_json(path, kind, advice="restore it from the run that wrote it")


def load_fingerprint(folder):
  """Fingerprint of the text encoder that a run was trained on, or None where the folder has none."""
  if not (pathlib.Path(folder) / TEXT).is_file():
    return None
  content = load_json(folder, TEXT)
  if not isinstance(content.get("fingerprint"), str):
    raise InputError(f"{pathlib.Path(folder) / TEXT} lacks the fingerprint of a text encoder; restore it from the run "
                     "that wrote it")
  return content["fingerprint"]


def load_lengths(folder):
  """(captions, usual frames) of the training data, or None where a run has none."""
  path = pathlib.Path(folder) / LENGTHS
  if not path.is_file():
    return None
  rows = load_json(folder, LENGTHS, list)
  if not rows or not all(isinstance(row, list) and len(row) == 2 and isinstance(row[0], str) and row[0].strip()
                         and isinstance(row[1], int | float) and 0 < row[1] < 1e9 for row in rows):
    raise InputError(f"{path} does not hold rows [caption, frames]; restore it from the run that wrote it")
  return [row[0] for row in rows], np.array([row[1] for row in rows])


def save_config(folder, config):
  save_text(folder, CONFIG, json.dumps({KEY: 1} | config.to_dict(), indent=1) + "\n")


def load_config(folder) -> ml_collections.FrozenConfigDict:
  config = load_json(folder, CONFIG)
  path = pathlib.Path(folder) / CONFIG
  advice = "restore it from the run that wrote it"
  check_version(config.pop(KEY, 1), f"the run folder {folder}")
  for section in _SECTIONS:
    if not isinstance(config.get(section) or {}, dict) or config.get(section) == "":
      raise InputError(f"{path}: {section} is {str(config[section])[:60]!r}, expected an object; {advice}")
  for section in _NETWORKS:
    check_sizes(config.get(section), path, section, advice)
  with reading(path, advice):
    return ml_collections.FrozenConfigDict(config)


_SECTIONS = ("model", "data", "train", "optimizer", "frozen", "sampler", "loss", "cleanup")
_NETWORKS = ("model", "tokenizer", "quantizer", "text", "length")  # sections of a config that describe a network


def building(folder):
  """Turns errors of the block, which builds networks from a run's config, into an InputError about the config."""
  return reading(pathlib.Path(folder) / CONFIG, "it does not describe a network that its weights belong to: restore it "
                 "from the run that wrote it")


def demand(config, folder, **ranges):
  """Raises InputError unless config holds a number for each name "section__field", in its range (least, most)."""
  for name, (least, most) in ranges.items():
    value = config
    for part in name.split("__"):
      value = value.get(part) if hasattr(value, "get") else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
      raise InputError(f"{pathlib.Path(folder) / CONFIG}: got {name.replace('__', '.')} {str(value)[:60]}, expected a "
                       f"number from {least} to {most}; restore it from the run that wrote it")
