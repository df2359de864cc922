"""Names that have changed: the former ones go on working, each with a note that says how it is called.

Keyword arguments of the functions of models, among them choices of sampling, those of `evaluate`, and fields of configs
are listed here; flags stand with their command as `Parser.former_flags`.
"""
import functools
import warnings

KEYWORDS = {"polish": "cleanup", "rounds": "num_iterations", "revealed_only": "unmasked_only",
            "repeats": "replications"}
FIELDS = {"data.unit": "data.frames_per_latent",
          "sampler.num_rounds": "sampler.num_iterations",
          "sampler.revealed_only": "sampler.unmasked_only"}

VALUES = {"fresh": "random-init"}  # of the fields of config.frozen, and of a text encoder's name


def note(old, new, stacklevel=3):
  """Warns that something is called otherwise; stacklevel: 3 is the line that called whoever calls this."""
  warnings.warn(f"{old} is called {new}; the old name goes on working", FutureWarning, stacklevel=stacklevel)


def current(given, names=None, stacklevel=3):
  """A dict of keyword arguments, or of what else names (KEYWORDS) tell of, by the names that they have."""
  found = dict(given)
  for old, new in (KEYWORDS if names is None else names).items():
    if old in found:
      if new in found:
        raise TypeError(f"got both {new} and {old}, which is its former name; give {new} alone")
      note(old, new, stacklevel + 1)
      found[new] = found.pop(old)
  return found


def rename_fields(config):
  """Gives fields of a config (a dict or an unlocked ConfigDict), and what they are, the names that they have: [(old,
  new)] of all that had others."""
  renamed = []
  for old, new in FIELDS.items():
    section, _, field = old.partition(".")
    place = config.get(section)
    if hasattr(place, "keys") and field in place:
      place[new.partition(".")[2]] = place[field]
      del place[field]
      renamed.append((f"config.{old}", f"config.{new}"))
  frozen = config.get("frozen")
  for field, value in frozen.items() if hasattr(frozen, "keys") else ():
    if isinstance(value, str) and value in VALUES:
      frozen[field] = VALUES[value]
      renamed.append((f"config.frozen.{field} {value!r}", repr(VALUES[value])))
  return renamed


def current_value(value):
  """A value by the name that it has."""
  if value in VALUES:
    note(repr(value), repr(VALUES[value]), 4)
  return VALUES.get(value, value)


def with_keywords(function):
  """A function that takes its keyword arguments by their former names, too."""
  @functools.wraps(function)
  def called(*args, **given):
    return function(*args, **current(given))

  return called
