"""Limits on what a config file may request of a network, checked before memory or time is spent on it."""
from typing import Any

from motion_jax.utils.errors import InputError

LARGEST = 1_000_000  # of any number: a width, a vocabulary, a count of positions
REPEATS = {"depth": 100, "num_layers": 100, "num_levels": 100, "num_halvings": 8}  # one module, one loop pass each


def check_sizes(value: Any, source: Any, name: str = "", advice: str = "restore it") -> None:
  """Raises InputError for a number in a config section, however deep, that no network has.

  source: the file, for the message; name: the section's name in it. A damaged digit in a depth would build modules
  without end, in a width fill the memory.
  """
  if isinstance(value, dict):
    for key, inner in value.items():
      check_sizes(inner, source, f"{name}.{key}".lstrip("."), advice)
  elif isinstance(value, list | tuple):
    for inner in value:
      check_sizes(inner, source, name, advice)
  elif isinstance(value, int | float):
    most = REPEATS.get(name.rpartition(".")[2], LARGEST)
    if not -most <= value <= most:
      raise InputError(f"{source}: got {name} {value:.6g}, expected at most {most}; {advice}")
