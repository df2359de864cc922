"""Changes of a config on the command line: --config.SECTION.FIELD=VALUE, with one-line errors."""
import ast
import difflib

import ml_collections
from absl import flags
from ml_collections import config_flags

from motion_jax.utils.errors import InputError

# Sections that take fields of any name: arguments of functions of optax, names of parts of a network.
OPEN = ("optimizer.fields", "optimizer.schedule_fields", "optimizer.rates")


def applied(arguments, config):
  """The locked config with the fields of --config.KEY=VALUE arguments. Raises InputError for any other argument."""
  arguments = _take_open_fields(arguments, config)
  check(arguments, config)
  values = flags.FlagValues()
  config_flags.DEFINE_config_dict("config", config, flag_values=values, sys_argv=["", *arguments])
  try:
    stray = values(["", *arguments])[1:]
  except (flags.Error, ValueError, AttributeError, KeyError, TypeError) as error:
    raise InputError(" ".join(str(error).split())) from error
  if stray:
    raise InputError(f"got the stray arguments {' '.join(stray)}; fields of the config are set by "
                     "--config.SECTION.FIELD=VALUE")
  return values.config


def _take_open_fields(arguments, config):
  """Sets the fields of OPEN sections; returns the other arguments."""
  rest = []
  for argument in arguments:
    key, equals, text = argument.lstrip("-").removeprefix("config.").partition("=")
    section, _, field = key.rpartition(".")
    if not argument.startswith("--config.") or not equals or section not in OPEN:
      rest.append(argument)
      continue
    try:
      value = ast.literal_eval(text)
    except (ValueError, SyntaxError):
      value = text
    outer, inner = section.split(".")
    try:
      with config.unlocked():
        config[outer][inner][field] = value
    except (KeyError, TypeError) as error:
      raise InputError(f"got {argument}, which does not fit this config ({' '.join(str(error).split())})") from error
  return rest


def names_any(arguments, *fields) -> bool:
  """Whether the arguments set one of these fields."""
  return any(argument.lstrip("-").partition("=")[0] == f"config.{field}" for argument in arguments for field in fields)


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
    if not equals:  # --config.flag alone is true
      value = None if isinstance(fields[key], bool) and str(following).startswith("--") else following
    _check_value(key, value, fields[key])


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
  """Raises InputError for a text that is not a value of the field's type."""
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
