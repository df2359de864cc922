"""Names of the steps of the pipeline, by which `without` leaves them out of a call."""
from collections.abc import Iterable

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import shortened

# Steps of each kind of generation that can be left out, which is all but sampling.
GENERATE = ("plan", "warn", "cleanup", "pose", "correct", "check", "constrain")
MULTI_PROMPT = ("plan", "warn", "cleanup", "pose")
EXTEND = ("plan", "warn", "cleanup")
EDIT = ("plan", "warn", "cleanup", "correct", "check")


def left_out(without: str | Iterable[str], names: Iterable[str] = GENERATE) -> frozenset[str]:
  """The steps that `without` names, as a text with commas or as a list. Raises InputError for a name not in `names`."""
  given = without.split(",") if isinstance(without, str) else list(without)
  normalized, names = {}, tuple(names)
  for name in given:
    if not isinstance(name, str):
      raise InputError(f"got {shortened(str(name))!r} as the name of a step, expected some of {', '.join(names)}")
    if name.strip():
      normalized[name] = name.strip().lower().replace("-", "").replace("_", "").replace(" ", "")
  if unknown := [name.strip() for name, known in normalized.items() if known not in names]:
    raise InputError(f"got the step {shortened(unknown[0])!r} to leave out, expected some of {', '.join(names)}")
  return frozenset(normalized.values())
