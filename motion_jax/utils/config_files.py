"""Configs by name or path: NAME[:SIZE] of one that ships, or FILE.py[:SIZE] of one's own."""
import importlib.util
import pathlib
from typing import TYPE_CHECKING, Any

from motion_jax import configs
from motion_jax.utils.errors import InputError

if TYPE_CHECKING:
  from ml_collections import ConfigDict

FOLDER = pathlib.Path(configs.__path__[0])  # where the configs lie that ship


def names() -> list[str]:
  """The configs that ship, such as cmdm_denoiser and ablations/cmdm."""
  files = [*sorted(FOLDER.glob("*.py")), *sorted(FOLDER.glob("ablations/*.py"))]
  return [name for path in files if not (name := path.relative_to(FOLDER).with_suffix("").as_posix()).endswith(
      ("__init__", "common"))]


def recipes() -> list[str]:
  """The recipes that ship, such as shipped/cmdm_small: configs of several passes, each of which trains a stage."""
  return [path.relative_to(FOLDER).with_suffix("").as_posix() for path in sorted(FOLDER.glob("shipped/*.py"))
          if path.stem not in ("__init__", "recipe")]


def load(name):
  """The config that NAME[:SIZE] or FILE.py[:SIZE] names. Raises InputError or FileNotFoundError that say what is wrong.
  """
  file, _, size = str(name).partition(":")
  path = _path_of(file)
  if path.suffix != ".py":
    raise InputError(f"got the config file {file!r}, expected Python with a function get_config(size), as in configs/")
  try:
    spec = importlib.util.spec_from_file_location("config", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    get_config = module.get_config
  except Exception as error:  # whatever a file that is no config does
    raise InputError(f"{file} is no config file ({type(error).__name__}: {error}); expected Python with a function "
                     "get_config(size)") from error
  return get_config(size) if size else get_config()


def _path_of(file):
  """The file of a config: the one that is given, or where there is none, the one of that name that ships."""
  path, short = pathlib.Path(file), file.removeprefix("configs/").removesuffix(".py")
  if path.is_file():
    return path
  if short in [*names(), *recipes()]:
    return FOLDER / f"{short}.py"
  known = [*names(), *recipes()]
  import difflib
  near = difflib.get_close_matches(path.stem, [pathlib.PurePath(name).name for name in known], 1, 0.5)
  hint = next(f"; did you mean {name}?" for name in known if name.endswith(near[0])) if near else (
      f"; it is the path of a Python file, or one of {', '.join(known)}")
  raise FileNotFoundError(f"there is no config {file!r}{hint}")


def lines_of(config: "ConfigDict") -> list[str]:
  """A config in readable lines, one a section: "section: field=value field=value"."""
  plain = {name: value.to_dict() if hasattr(value, "to_dict") else value for name, value in config.items()}
  single = [f"{name}={_written(value)}" for name, value in plain.items() if not isinstance(value, dict)]
  sections = [f"{name}: {' '.join(f'{key}={_written(inner)}' for key, inner in _flat(value))}"
              for name, value in plain.items() if isinstance(value, dict) and value]
  return [" ".join(single), *sections]


def _flat(section, prefix=""):
  for key, value in section.items():
    if isinstance(value, dict):
      yield from _flat(value, f"{prefix}{key}.")
    else:
      yield prefix + key, value


def _written(value):
  if isinstance(value, list | tuple):
    return f"({','.join(map(_written, value))})"
  return f"{value:g}" if isinstance(value, float) else repr(value) if value == "" or " " in str(value) else str(value)


def module_fields(section: "ConfigDict") -> dict[str, Any]:
  """A section of a config as fields of a Flax module: lists become tuples, which can be hashed."""
  return {name: tuple(value) if isinstance(value, list | tuple) else value for name, value in section.to_dict().items()}
