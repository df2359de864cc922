"""Measurements in a file of one JSON row a line: a run that is cut short loses at most one row and continues there."""
import json
import pathlib
import re
import sys
import time
from collections.abc import Callable, Mapping

from motion_jax.utils.atomic import atomic_path


def measure(out: pathlib.Path, wanted: Mapping[str, Callable[[], dict]], seconds: float, about: Mapping,
            after_each: Callable[[], None] = lambda: None) -> bool:
  """Runs the wanted pieces that have no row in `out` (a .jsonl file) yet; True if nothing is left.

  Begins nothing after `seconds`. about: fields of every row, such as the device. The row of a piece that fails, or that
  ends the program, holds the error, and the others run. Delete a line to measure its piece again.
  """
  began = time.monotonic()
  for name, run in wanted.items():
    if name in pieces_of(out):
      continue
    if time.monotonic() - began > seconds:
      print(f"{seconds:g} s are over; the same command continues at {name}")
      return False
    write(out, dict(piece=name, error="the program ended in this piece") | about)  # until it is done
    try:
      measured = run()
    except Exception as error:  # out of memory, an operation that the device lacks: the others go on
      measured = dict(error=f"{type(error).__name__}: {str(error)[:300]}")
    write(out, dict(piece=name) | measured | about)
    print(name, json.dumps({key: float(f"{value:.4g}") if isinstance(value, float) else value
                            for key, value in measured.items() if not isinstance(value, (dict, list))}), flush=True)
    after_each()
  return True


def read(out: pathlib.Path) -> list[dict]:
  """The rows of a file in order; none if there is no file yet."""
  return list(map(json.loads, out.read_text().splitlines())) if out.is_file() else []


def pieces_of(out: pathlib.Path) -> set[str]:
  return {row["piece"] for row in read(out)}


def write(out: pathlib.Path, row: Mapping) -> None:
  """Adds a row, in place of the row of the same piece if there is one; rows are sorted by piece."""
  keep(out, [*(other for other in read(out) if other["piece"] != row["piece"]), row])


def keep(out: pathlib.Path, rows) -> None:
  """Writes a file of these rows alone."""
  with atomic_path(out) as whole:
    whole.write_text("".join(json.dumps(row) + "\n" for row in sorted(rows, key=_order)))


def _order(row):
  return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", row["piece"])]


def markdown(columns, lines) -> str:
  """A Markdown table of cells that are text or numbers."""
  if not lines:
    print(f"no rows for the table of {columns[0]}", file=sys.stderr)
  cell = lambda value: f"{value:.4g}" if isinstance(value, float) else str(value)
  return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in (columns, ["---"] * len(columns), *lines))
