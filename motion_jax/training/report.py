"""report.html of a run folder: curves, speed, where it ran, its config; one file that loads nothing from anywhere."""
import base64
import json
import pathlib
import time
from typing import NamedTuple

import jinja2
import numpy as np

from motion_jax import charts
from motion_jax.training.metrics import read_metrics
from motion_jax.training.progress import duration
from motion_jax.utils.atomic import atomic_path

REPORT, SAMPLES = "report.html", "samples"
_SPEED = {"samples_per_second": "samples a second", "data_wait": "share of time spent waiting for data",
          "mfu": "MFU: share of the devices' peak in bfloat16", "memory_mb": "memory, MB"}
_STEPS = {"grad_norm": "norm of the gradient", "learning_rate": "learning rate", "skipped": "share of steps left out"}
_LOGARITHMIC = ("loss", "grad_norm")
_NO_TERMS = {"step", "seconds", "loss", *_SPEED, *_STEPS}
_MOST_PICTURES = 6


class Figure(NamedTuple):
  """A chart: its title, its lines' colours and names, and the drawing."""
  title: str
  names: list[tuple[str, str]]
  svg: str


def write(workdir, config, environment) -> pathlib.Path:
  """Writes report.html from metrics.jsonl, samples/*.png and environment {label: value}; returns its path."""
  workdir = pathlib.Path(workdir)
  rows = read_metrics(workdir)
  trained, judged = [row for row in rows if "seconds" in row], [row for row in rows if "seconds" not in row]
  template = jinja2.Environment(autoescape=True, trim_blocks=True).from_string(
      (pathlib.Path(__file__).parent / "assets" / "report.html.j2").read_text(encoding="utf-8"))
  text = template.render(
      name=workdir.resolve().name, stage=config.get("stage", ""), step=max((row["step"] for row in rows), default=0),
      num_steps=config.train.num_steps, written=time.strftime("%Y-%m-%d %H:%M"), tiles=_tiles(trained, judged),
      sections=[one for one in _sections(trained, judged) if one[1]], pictures=_pictures(workdir),
      about=list(environment.items()), config=json.dumps(config.to_dict(), indent=1))
  with atomic_path(workdir / REPORT) as path:
    path.write_text(text, encoding="utf-8")
  return workdir / REPORT


def smoothed(values, over=0.05):
  """An exponential average that looks back over this share of the values, and begins without a bias to zero."""
  keep, total, weight, found = 1 - 1 / max(over * len(values), 1), 0.0, 0.0, []
  for value in values:
    if np.isfinite(value):
      total, weight = keep * total + (1 - keep) * value, keep * weight + (1 - keep)
    found.append(total / weight if weight else value)
  return found


def _tiles(trained, judged):
  if not trained:
    return []
  last, tiles = trained[-1], []
  tiles.append(("loss", f"{smoothed([row['loss'] for row in trained])[-1]:.4g}"))
  tiles += [(name.replace("_", " "), f"{value:.4g}") for row in judged[-1:] for name, value in row.items()
            if name != "step"]
  tiles += [(_SPEED[name].partition(",")[0], f"{100 * last[name]:.1f} %" if name in ("data_wait", "mfu") else
             f"{last[name]:.4g}") for name in _SPEED if name in last]
  left_out = sum(row.get("skipped", 0.0) * (row["step"] - before) for row, before in zip(
      trained, [0] + [row["step"] for row in trained]))
  tiles += [("steps left out", f"{left_out:.0f}")] if any("skipped" in row for row in trained) else []
  return tiles + [("of training", duration(last["seconds"]))]


def _sections(trained, judged):
  terms = sorted({name for row in trained for name in row} - _NO_TERMS)
  yield "Loss", [figure for figure in (_loss(trained), *(_lines([term], trained, {}) for term in terms)) if figure]
  names = sorted({name for row in judged for name in row} - {"step"})
  yield "On held-out data", [figure for name in names if (figure := _lines([name], judged, {}))]
  yield "Steps", [figure for name in _STEPS if (figure := _lines([name], trained, _STEPS))]
  yield "Speed", [figure for name in _SPEED if (figure := _lines([name], trained, _SPEED))]


def _loss(rows):
  """The loss as it was logged, pale by being thin, and smoothed."""
  points = [(row["step"], row["loss"]) for row in rows if np.isfinite(row.get("loss", np.nan))]
  if not points:
    return None
  steps, losses = zip(*points)
  lines = [charts.Series("as logged", steps, losses), charts.Series("smoothed", steps, smoothed(losses))]
  return _figure("loss", lines, "loss")


def _lines(names, rows, titles):
  lines = [charts.Series(name, *zip(*points)) for name in names if (
      points := [(row["step"], row[name]) for row in rows if np.isfinite(row.get(name, np.nan))])]
  return _figure(titles.get(names[0], names[0].replace("_", " ")), lines, names[0]) if lines else None


def _figure(title, lines, name):
  lowest = min(value for line in lines for value in line.y)
  svg = charts.svg(lines, "step", name.replace("_", " "), title, logarithmic=name in _LOGARITHMIC and lowest > 0)
  return Figure(title, [(kind, line.name) for kind, line in zip(charts.kinds(lines), lines)] if lines[1:] else [], svg)


def _pictures(workdir):
  found = sorted((workdir / SAMPLES).glob("step*.png"))
  kept = found[::-1][::max(1, -(-len(found) // _MOST_PICTURES))]  # the newest first
  return [(path.stem.replace("_", " "), base64.b64encode(path.read_bytes()).decode()) for path in kept]
