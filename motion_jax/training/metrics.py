"""metrics.jsonl of a run folder, a row of numbers for each step that is told: written, cut, read and drawn."""
import errno
import json
import os
import pathlib

import numpy as np

from motion_jax import charts
from motion_jax.training.distributed import by_first
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.input_files import read_json_lines

METRICS = "metrics.jsonl"
CLOCK = ("seconds", "samples_per_second", "data_wait", "memory_mb", "mfu")  # what differs from machine to machine


def read_metrics(folder) -> list[dict]:
  """The rows of a run, as dicts; none where there is no file."""
  path = pathlib.Path(folder) / METRICS
  return [row for _, row in read_json_lines(path)] if path.is_file() else []


def without_clock(rows) -> list[dict]:
  """Rows less what a clock or a machine says: the same for the same run."""
  return [{key: value for key, value in row.items() if key not in CLOCK} for row in rows]


def was_evaluated(folder, step) -> bool:
  """Whether the evaluation after the save of a step has its row; rows of training say how many seconds it took."""
  return any(row["step"] == step and "seconds" not in row for row in read_metrics(folder))


@by_first
def trim_metrics(folder, last):
  """Drops the rows of metrics.jsonl after step `last`: a run that goes on from there writes them again.

  A line cut short, by a machine that went down, goes too.
  """
  path = pathlib.Path(folder) / METRICS
  if not path.is_file():
    return
  lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
  kept = [line for line in lines if _step_of(line) <= last]
  if len(kept) < len(lines):
    with atomic_path(path) as whole:
      whole.write_text("".join(line + "\n" for line in kept), encoding="utf-8")


def _step_of(line):
  try:
    return json.loads(line)["step"]
  except (ValueError, KeyError, TypeError):
    return np.inf


def rounded(row) -> dict:
  """A row with the six digits of each number that are written."""
  return {key: float(f"{value:.6g}") if isinstance(value, float) else value for key, value in row.items()}


@by_first
def append_metrics(folder, row):
  """Adds a row, a dict with its "step", at the end of metrics.jsonl."""
  line = json.dumps(row) + "\n"
  with open(pathlib.Path(folder) / METRICS, "ab", buffering=0) as file:
    end = file.seek(0, os.SEEK_END)
    try:
      written = file.write(line.encode())
      if written < len(line):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError:
      file.truncate(end)
      raise


@by_first
def draw_curve(folder):
  """loss.png: the loss over the steps, on a logarithmic axis where all values are positive."""
  points = [(row["step"], row["loss"]) for row in read_metrics(folder) if np.isfinite(row.get("loss", np.nan))]
  if not points:
    return
  steps, losses = zip(*points)
  # Sums of log-densities may be negative: then the axis is linear.
  image = charts.picture([charts.Series("", steps, losses)], "step", "loss", logarithmic=min(losses) > 0)
  with atomic_path(pathlib.Path(folder) / "loss.png") as path:
    image.save(path)
