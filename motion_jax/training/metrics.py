"""metrics.jsonl of a run folder, a row of numbers for each step that is told: written, cut, read and drawn."""
import json
import pathlib

import numpy as np
from PIL import Image, ImageDraw

from motion_jax.inputs.input_files import read_json_lines
from motion_jax.runtime.atomic import atomic_path

METRICS = "metrics.jsonl"


def read_metrics(folder) -> list[dict]:
  """The rows of a run, as dicts; none where there is no file."""
  path = pathlib.Path(folder) / METRICS
  return [row for _, row in read_json_lines(path)] if path.is_file() else []


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


def append_metrics(folder, row):
  """Adds a row, a dict with its "step", at the end of metrics.jsonl."""
  with open(pathlib.Path(folder) / METRICS, "a", encoding="utf-8") as file:
    file.write(json.dumps({key: float(f"{value:.6g}") if isinstance(value, float) else value
                           for key, value in row.items()}) + "\n")


def draw_curve(folder, size=(900, 420)):
  """loss.png: the loss over the steps, on a logarithmic axis where all values are positive."""
  points = [(row["step"], row["loss"]) for row in read_metrics(folder) if np.isfinite(row.get("loss", np.nan))]
  if not points:
    return
  steps, losses = np.array(points, float).T
  # Sums of log-densities may be negative: then the axis is linear.
  logarithmic = losses.min() > 0
  values = np.log10(losses) if logarithmic else losses
  low, high = values.min(), max(values.max(), values.min() + 1e-6)
  width, height, margin = *size, 60
  image = Image.new("RGB", size, "white")
  draw = ImageDraw.Draw(image)
  draw.rectangle((margin, 20, width - 20, height - 40), outline=(200, 200, 200))
  x = margin + (steps - steps[0]) / max(steps[-1] - steps[0], 1) * (width - 20 - margin)
  y = 20 + (high - values) / (high - low) * (height - 60)
  draw.line(list(zip(x, y)) if len(x) > 1 else [(x[0], y[0]), (x[0] + 1, y[0])], fill=(40, 90, 200), width=2)
  for value in (low, high):
    label = f"{10 ** value if logarithmic else value:.4g}"
    draw.text((4, 14 + (high - value) / (high - low) * (height - 60)), label, fill="black")
  draw.text((margin, height - 34), f"step {steps[0]:.0f}", fill="black")
  draw.text((width - 110, height - 34), f"step {steps[-1]:.0f}", fill="black")
  with atomic_path(pathlib.Path(folder) / "loss.png") as path:
    image.save(path)
