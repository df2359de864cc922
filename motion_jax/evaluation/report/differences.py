"""Tables of differences between rows of a result, on the same captions."""
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import Result


def comparisons(result: Result) -> list[tables.Comparison]:
  """A table for each row that others are compared with; a number is marked if its interval leaves 0 out."""
  blocks = []
  for against in dict.fromkeys(difference["against"] for difference in result.differences):
    some = [difference for difference in result.differences if difference["against"] == against]
    metrics = [metric for metric in result.metrics if any(metric in difference["metrics"] for difference in some)]
    lines = [tables.Line(difference["row"], "ours",
                         [_cell(metric, difference["metrics"].get(metric)) for metric in metrics])
             for difference in some]
    blocks.append(tables.Comparison(f"Differences from {against}, on the same captions", metrics, lines, [
        "Row less row, and half of the 95 % interval over test clips: a bootstrap that draws the same clips for both.",
        "* differs from 0 by more than that."]))
  return blocks


def whole(form):
  """form(result) of a result's table, followed by the tables of differences."""
  return lambda result: "\n".join(map(form, (result, *comparisons(result))))


def _cell(metric, value):
  if value is None or value["mean"] is None:
    return tables.Cell("–")
  digits = tables.METRICS[metric].digits if metric in tables.METRICS else 3
  return tables.Cell(f"{value['mean']:+.{digits}f}", f"{value['interval']:.{digits}f}",
                     abs(value["mean"]) > value["interval"])
