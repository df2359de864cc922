"""Names of the steps of the pipeline, by which `without` leaves them out of a call."""
from collections.abc import Iterable

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import shortened

# The steps that each way to make a motion has besides sampling, which always stays.
GENERATE = ("plan", "warn", "cleanup", "pose", "correct", "check", "constrain")
MULTI_PROMPT = ("plan", "warn", "cleanup", "pose")
EXTEND = ("plan", "warn", "cleanup")
EDIT = ("plan", "warn", "cleanup", "correct", "check")


def left_out(without: str | Iterable[str], names: Iterable[str] = GENERATE) -> frozenset[str]:
  """The steps that `without` names, a text with commas or a list. Raises InputError for any that is not in `names`."""
  given = without.split(",") if isinstance(without, str) else list(without)
  found, names = {}, tuple(names)
  for name in given:
    if not isinstance(name, str):
      raise InputError(f"got {shortened(str(name))!r} as the name of a step, expected some of {', '.join(names)}")
    if name.strip():
      found[name] = name.strip().lower().replace("-", "").replace("_", "").replace(" ", "")
  if unknown := [name.strip() for name, known in found.items() if known not in names]:
    raise InputError(f"got the step {shortened(unknown[0])!r} to leave out, expected some of {', '.join(names)}")
  return frozenset(found.values())
