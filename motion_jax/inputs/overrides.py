"""A config file and what a command line changes of it, read for launch.py: mistakes are told in one line."""
import difflib
import importlib.util
import pathlib

import ml_collections

from motion_jax.inputs.errors import InputError


def config_of(name):
  """The config that FILE or FILE:SIZE names. Raises InputError or FileNotFoundError that say what is wrong with it."""
  name = str(name)
  file, _, size = name.partition(":")
  path = pathlib.Path(file)
  if not path.is_file():
    shipped = sorted(map(str, path.parent.glob("*.py"))) or sorted(map(str, pathlib.Path("configs").glob("*.py")))
    near = difflib.get_close_matches(path.name, [pathlib.Path(one).name for one in shipped], 1, 0.5)
    hint = f"; did you mean {next(one for one in shipped if pathlib.Path(one).name == near[0])}?" if near else (
        "; it is given as configs/NAME.py or configs/NAME.py:SIZE")
    raise FileNotFoundError(f"there is no config file {file!r}{hint}")
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


def check(arguments, config):
  """Raises InputError for the first --config.KEY=VALUE among the arguments that the config has no place for."""
  fields = dict(_fields(config))
  for argument, following in zip(arguments, [*arguments[1:], None]):
    key, equals, value = argument.lstrip("-").partition("=")
    if not argument.startswith("-") or not key.startswith("config."):
      continue
    key = key.removeprefix("config.")
    if key not in fields and key.startswith("no") and isinstance(fields.get(key[2:]), bool):
      continue  # absl's --noconfig.flag
    if key not in fields:
      raise InputError(f"got --config.{key}, which this config does not have{_nearest(key, fields)}")
    if isinstance(fields[key], ml_collections.ConfigDict):
      inside = [f"--config.{name}" for name in fields if name.startswith(key + ".")]
      raise InputError(f"got --config.{key}, which is a section; set its fields, such as {' '.join(inside[:3])}")
    _check_value(key, value if equals else following, fields[key])


def _fields(config, prefix=""):
  """(dotted name, value) of all fields and sections."""
  for key in config:
    value = config[key] if config.get_type(key) is not None else None
    yield prefix + key, value
    if isinstance(value, ml_collections.ConfigDict):
      yield from _fields(value, f"{prefix}{key}.")


def _nearest(key, fields):
  last = key.rpartition(".")[2]
  same = [name for name in fields if name.rpartition(".")[2] == last]  # the right word in the wrong section
  near = same[:1] or difflib.get_close_matches(key, fields, 1, 0.6) or [
      name for word in difflib.get_close_matches(last, [name.rpartition(".")[2] for name in fields], 1, 0.6)
      for name in fields if name.rpartition(".")[2] == word][:1]
  return f"; did you mean --config.{near[0]}?" if near else f"; it has {', '.join(dict.fromkeys(fields))}"


def _check_value(key, text, usual):
  """Raises InputError for a text that is no value of the type that a field has."""
  kinds = {bool: "True or False", int: "a whole number", float: "a number"}
  kind = type(usual)
  if text is None or kind not in kinds:
    return  # words take any text; lists and the like are absl's affair
  try:
    fits = text.lower() in ("true", "false", "1", "0") if kind is bool else bool([kind(text)])
  except ValueError:
    fits = False
  if not fits:
    raise InputError(f"got --config.{key}={text}, expected {kinds[kind]} such as {usual}")


def value_of(flag, arguments):
  """What --FLAG VALUE or --FLAG=VALUE says among arguments, the last one, or None."""
  found = None
  for argument, following in zip(arguments, [*arguments[1:], None]):
    name, equals, value = argument.partition("=")
    if name in (f"--{flag}", f"-{flag}"):
      found = value if equals else following
  return found
