"""Aggregates over replications: means, intervals and curves, as values that JSON can hold."""
import dataclasses
import math

import numpy as np
from scipy.stats import t as student

from motion_jax.evaluation import differences


def collect(scores, population=True):
  """({row: {metric: {"mean", "interval", "values"}}}, {row: [curve of each replication]}) from the results of a task in
  each replication, [`tasks.base.TaskScores`].
  """
  values, curves = {}, {}
  for scored in scores:
    for row, numbers in scored.rows.items():
      for metric, number in numbers.items():
        values.setdefault(row, {}).setdefault(metric, []).append(number)
    for row, curve in scored.curves.items():
      curves.setdefault(row, []).append(curve)
  return {row: {metric: interval(numbers, population) for metric, numbers in metrics.items()}
          for row, metrics in values.items()}, curves


def interval(values, population=True) -> dict:
  """Mean and half width of the 95 % interval over R replications; None for a single one.

  population: 1.96 std / sqrt(R) with the population std, as the papers do for R = 10 and 20; otherwise Student's t with
  R - 1 degrees of freedom takes the place of 1.96, which also holds for few replications.
  """
  values = np.asarray(values, np.float64)
  half, count = None, len(values)
  if count > 1:
    times = 1.96 if population else student.ppf(0.975, count - 1)
    half = float(times * values.std(ddof=0 if population else 1) / math.sqrt(count))
  return dict(mean=float(values.mean()), interval=half, values=values.tolist())


def spread(row) -> dict:
  """{metric: standard deviation over replications} of a row with several replications."""
  return {metric: float(np.std(cell["values"], ddof=1)) for metric, cell in row.items() if len(cell["values"]) > 1}


def compared(made, by_motion, seed) -> list[dict]:
  """The difference of each row to the first row of its part, on the same captions. made: {row: (candidate, part)},
  by_motion: {row: [`ByMotion` of each replication]}.
  """
  comparisons, first = [], {}
  for row, (_, part) in made.items():
    if row not in by_motion:
      continue
    against = first.setdefault(part, row)
    if against != row:
      comparisons.append(dict(row=row, against=against,
                              metrics=differences.over_clips(by_motion[row], by_motion[against], seed)))
  return comparisons


def uncertain(harness, made, by_motion, compared) -> list[str]:
  """For a small test set: sentences on how much the numbers of the first row would vary with other test clips."""
  row = next((row for row in made if row in by_motion), None)
  if harness.count > harness.evaluator.dim or row is None:
    return []
  intervals = differences.over_clips(by_motion[row], seed=harness.seed)
  amounts = ", ".join(f"{label} ± {intervals[metric]['interval']:.2g}" for metric, label in (
      ("top1", "R@1"), ("top3", "R@3"), ("fid", "FID"), ("matching", "MM-Dist"), ("clip_score", "CLIP-score"))
      if metric in intervals)
  return [f"Of {harness.count} test clips: on others like them the numbers of {row} would differ by {amounts} (95 %, "
          "bootstrap over clips)" + (": compare rows by their differences below" if compared else "")]


def row_name(name, part):
  return f"{part}: {name}" if part else name


def guidance_curves(rows, candidates):
  """FID and R-precision against the guidance scale, where there are several scales."""
  curves = {}
  for name in dict.fromkeys(candidate.name.partition(", guidance")[0] for candidate in candidates):
    guided = [candidate for candidate in candidates
              if candidate.name.startswith(f"{name}, guidance") and "fid" in rows.get(candidate.name, {})]
    guided.sort(key=lambda candidate: candidate.guidance_scale)
    for metric, label in (("fid", "FID"), ("top3", "R@3")):
      if guided and metric in rows[guided[0].name]:
        cells = [rows[candidate.name][metric] for candidate in guided]
        curves[f"{label} against guidance, {name}"] = dict(
            x=[candidate.guidance_scale for candidate in guided], y=[cell["mean"] for cell in cells],
            interval=[cell["interval"] or 0.0 for cell in cells], x_label="guidance scale", y_label=label)
  return curves


def transition_curves(curves, population):
  """Mean jerk across transitions of the rows whose task measures it; curves as of `collect`."""
  drawn = {}
  for name, replications in curves.items():
    intervals = [interval(values, population) for values in np.transpose(replications)]
    half = (len(intervals) - 1) / 2
    drawn[f"jerk across transitions, {name}"] = dict(
        x=[i - half for i in range(len(intervals))], y=[point["mean"] for point in intervals],
        interval=[point["interval"] or 0.0 for point in intervals], x_label="frames from the border", y_label="jerk")
  return drawn


def json_ready(value):
  """The value with types that JSON has; numbers that are not finite become null."""
  if isinstance(value, dict):
    return {str(key): json_ready(item) for key, item in value.items()}
  if isinstance(value, list | tuple):
    return [json_ready(item) for item in value]
  if isinstance(value, np.generic):
    value = value.item()
  if isinstance(value, float) and not math.isfinite(value):
    return None
  if dataclasses.is_dataclass(value):
    return json_ready(dataclasses.asdict(value))
  return value
