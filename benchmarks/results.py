"""Measurements as files, one a row, so that a run that is cut short loses at most one and continues where it was."""
import json
import pathlib
import sys
import time
from collections.abc import Callable, Mapping

from motion_jax.utils.atomic import atomic_path


def measure(out: pathlib.Path, wanted: Mapping[str, Callable[[], dict]], seconds: float, about: Mapping,
            after_each: Callable[[], None] = lambda: None) -> bool:
  """Runs what is wanted and has no file in out yet, each into a file of its own; True if nothing is left.

  Begins nothing after `seconds`. about: what every row holds besides, such as the device. A row that fails leaves its
  error in its file and the others run; so does one that ends the program. Remove the file to measure it again.
  """
  began = time.monotonic()
  for name, run in wanted.items():
    path = path_of(out, name)
    if path.exists():
      continue
    if time.monotonic() - began > seconds:
      print(f"{seconds:g} s are over; the same command continues at {name}")
      return False
    write(path, dict(piece=name, error="the program ended in this piece") | about)  # until it is done
    try:
      found = run()
    except Exception as error:  # out of memory, an operation that the device lacks: the others go on
      found = dict(error=f"{type(error).__name__}: {str(error)[:300]}")
    write(path, dict(piece=name) | found | about)
    print(name, json.dumps({key: float(f"{value:.4g}") if isinstance(value, float) else value
                            for key, value in found.items() if not isinstance(value, (dict, list))}), flush=True)
    after_each()
  return True


def path_of(out: pathlib.Path, name: str) -> pathlib.Path:
  return out / f"{name.replace('/', '-').replace(' ', '-')}.json"


def read(out: pathlib.Path, prefix: str = "") -> list[dict]:
  """The rows of a folder whose pieces begin so, in the order of their files' names."""
  found = [json.loads(path.read_text()) for path in sorted(out.glob("*.json"))]
  return [row for row in found if row.get("piece", "").startswith(prefix)]


def write(path: pathlib.Path, content) -> None:
  with atomic_path(path) as whole:
    whole.write_text(json.dumps(content, indent=1) + "\n")


def markdown(columns, lines) -> str:
  """A Markdown table of cells that are text or numbers."""
  if not lines:
    print(f"no rows for the table of {columns[0]}", file=sys.stderr)
  cell = lambda value: f"{value:.4g}" if isinstance(value, float) else str(value)
  return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in (columns, ["---"] * len(columns), *lines))
