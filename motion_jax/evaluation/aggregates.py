"""Rows of numbers over repeats: means, intervals, curves, and what JSON can hold of them."""
import dataclasses
import math

import numpy as np
from scipy.stats import t as student

from motion_jax.evaluation.checks import controls as controls_lib


def collect(of_repeat, repeats, population):
  """{row: {metric: {"mean", "interval", "values"}}} of of_repeat(repeat) -> {row: {metric: number}}."""
  values = {}
  for repeat in range(repeats):
    for row, numbers in of_repeat(repeat).items():
      for metric, number in numbers.items():
        values.setdefault(row, {}).setdefault(metric, []).append(number)
  return {row: {metric: interval(numbers, population) for metric, numbers in found.items()}
          for row, found in values.items()}


def interval(values, population=True) -> dict:
  """Mean and half width of the 95 % interval over R repeats, None of a single one.

  population: 1.96 std / sqrt(R), std of the numbers themselves, as the papers have it for R of 10 and 20; else
  Student's t of R - 1 degrees takes the place of 1.96, which is honest for few repeats, too.
  """
  values = np.asarray(values, np.float64)
  half, count = None, len(values)
  if count > 1:
    times = 1.96 if population else student.ppf(0.975, count - 1)
    half = float(times * values.std(ddof=0 if population else 1) / math.sqrt(count))
  return dict(mean=float(values.mean()), interval=half, values=values.tolist())


def spread(row) -> dict:
  """{metric: std over repeats} of a row, where it has several."""
  return {metric: float(np.std(one["values"], ddof=1)) for metric, one in row.items() if len(one["values"]) > 1}


def row_name(name, part):
  return f"{part}: {name}" if part else name


def curves_of(rows, subjects, checked):
  """FID against guidance where several scales were asked for, R-precision against noise where controls ran."""
  curves = {}
  for name in dict.fromkeys(subject.name.partition(", guidance")[0] for subject in subjects):
    own = [s for s in subjects if s.name.startswith(f"{name}, guidance") and "fid" in rows.get(s.name, {})]
    own.sort(key=lambda subject: subject.guidance_scale)
    if own:
      for metric, label in (("fid", "FID"), ("top3", "R@3")):
        if metric not in rows[own[0].name]:
          continue
        found = [rows[subject.name][metric] for subject in own]
        curves[f"{label} against guidance, {name}"] = dict(
            x=[subject.guidance_scale for subject in own], y=[one["mean"] for one in found],
            interval=[one["interval"] or 0.0 for one in found], x_label="guidance scale", y_label=label)
  return curves | (controls_lib.curves(checked) if checked else {})


def drawn(curves, population):
  """Jerk across transitions, mean over repeats, of the rows whose task draws it."""
  made = {}
  for name, rows in curves.items():
    found = [interval(values, population) for values in np.transpose(rows)]
    half = (len(found) - 1) / 2
    made[f"jerk across transitions, {name}"] = dict(
        x=[i - half for i in range(len(found))], y=[one["mean"] for one in found],
        interval=[one["interval"] or 0.0 for one in found], x_label="frames from the border", y_label="jerk")
  return made


def plain(value):
  """Only what JSON knows: numbers that are not finite are null."""
  if isinstance(value, dict):
    return {str(key): plain(one) for key, one in value.items()}
  if isinstance(value, list | tuple):
    return [plain(one) for one in value]
  if isinstance(value, np.generic):
    value = value.item()
  if isinstance(value, float) and not math.isfinite(value):
    return None
  if dataclasses.is_dataclass(value):
    return plain(dataclasses.asdict(value))
  return value
