"""Mapping files: which joint of a motion-capture file is which of ours, where its names are not known."""
import pathlib

from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json
from motion_jax.utils.numerals import named


def read_mapping(mapping):
  """A mapping {our joint: their joint or a list of them} from a JSON file; a dict, a table's name, or None as it is."""
  if not isinstance(mapping, (str, pathlib.Path)) or (isinstance(mapping, str) and not mapping.endswith(".json")):
    return mapping
  path = pathlib.Path(mapping)
  if not path.is_file():
    raise FileNotFoundError(f"there is no mapping file {path}")
  value = read_json(path, advice="expected {our joint: their joint or a list of them}")
  names = lambda entry: isinstance(entry, str) or (isinstance(entry, list) and entry and all(map(names, entry)))
  bad = [joint for joint, entry in value.items() if not names(entry)]
  if bad:
    raise InputError(f"{path}: {named(bad, 10)} should be a joint's name or a list of names")
  return value
