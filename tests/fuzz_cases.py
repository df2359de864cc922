"""A case of the fuzzer: what it writes and what it runs."""
from collections.abc import Callable
from typing import NamedTuple

from motion_jax_studio.cli import main
from tests.fuzz_damage import damage, pick


class Case(NamedTuple):
  """call() is what is tried, inside its folder; what it may write lies in the sub-folder out."""
  what: str
  call: Callable


def command(*arguments):
  """A case that is a command line."""
  arguments = [str(argument) for argument in arguments]
  return Case("motion-jax " + " ".join(map(repr, arguments)), lambda: main(arguments))


def damaged(rng, files, names=None) -> dict[str, bytes]:
  """Files of which one or two (of those with these endings) are damaged, or gone."""
  files = dict(files)
  for _ in range(1 + (rng.random() < 0.2)):
    name = pick(rng, [name for name in files if names is None or name.endswith(names)] or list(files))
    if rng.random() < 0.03 and names is None:
      del files[name]
    else:
      files[name] = damage(rng, name, files[name])
    if not files:
      break
  return files
