"""The result of an evaluation: the fields of results.json.

The values are plain JSON; names in the file are those of the fields.
"""
import dataclasses
import json
import pathlib
from typing import Any, NotRequired, Self, TypedDict

from motion_jax.training import checkpoint
from motion_jax.utils.atomic import atomic_path

HALVES = "two halves of real"  # a row: how far apart motions are that differ by chance alone
FILE = "results.json"


class Number(TypedDict):
  """A metric over replications; interval: half of the 95 % interval, None of a single one."""
  mean: float | None
  interval: float | None
  values: list[float]


class Paper(TypedDict):
  """The rows of the papers that are shown next to ours; see `report.tables.compare`."""
  system: str
  table: str
  row: str | dict[str, Any]
  also: NotRequired[list]
  unmarked: NotRequired[list[str]]


class Differences(TypedDict):
  """A row minus another, on the same captions; interval: over test clips (`evaluation.differences`)."""
  row: str
  against: str
  metrics: dict[str, dict[str, float]]


class Sanity(TypedDict):
  """Scores of real motions, shuffled captions and noise; see `checks.sanity.check`."""
  real: dict[str, float]
  shuffled: dict[str, float]
  fid_noise: float
  fid_halves: NotRequired[float]
  failures: list[str]
  warnings: NotRequired[list[str]]


class Expectation(TypedDict):
  """The behaviour of one metric under one control; see `checks.controls.check`."""
  control: str
  metric: str
  direction: str
  real: float
  values: list[float]
  ok: bool
  noticed: NotRequired[float | None]


class Controls(TypedDict):
  """Rows of damaged motions, and whether every metric reacted."""
  rows: dict[str, dict[str, float]]
  levels: NotRequired[list[float]]
  expected: list[Expectation]
  failures: list[str]


class Curve(TypedDict):
  """A line of a chart."""
  x: list[float]
  y: list[float]
  interval: list[float] | None
  x_label: str
  y_label: str


class Shown(TypedDict):
  """A generated motion of the gallery next to the real one, files relative to the result's folder; kind "grid" or
  "failure".
  """
  caption: str
  kind: str
  score: float
  row: NotRequired[str]
  real: str
  made: str


@dataclasses.dataclass(frozen=True)
class Result:
  """Rows of metrics by a protocol, with what is shown next to them, and their provenance.

  rows: {row: {metric: number}}, row_order: the rows of tables, metrics: their columns. provenance: data, models,
  evaluators, seeds and code (`evaluation.provenance`). folder: of the result, not part of it.
  """
  protocol: str
  title: str
  rows: dict[str, dict[str, Number]]
  row_order: list[str]
  metrics: list[str]
  paper: Paper | None = None
  notes: list[str] = dataclasses.field(default_factory=list)
  provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
  sanity: Sanity | None = None
  controls: Controls | None = None
  differences: list[Differences] = dataclasses.field(default_factory=list)
  curves: dict[str, Curve] = dataclasses.field(default_factory=dict)
  gallery: list[Shown] = dataclasses.field(default_factory=list)
  folder: pathlib.Path | None = dataclasses.field(default=None, compare=False)

  def as_json(self) -> dict[str, Any]:
    return {name: getattr(self, name) for name in _FIELDS if name != "differences" or self.differences}

  @classmethod
  def from_json(cls, data: dict[str, Any], folder: pathlib.Path | None = None) -> Self:
    """Raises ValueError for JSON that is not a result."""
    missing = [name for name in _REQUIRED if name not in data]
    if missing:
      raise ValueError(f"{folder or 'this'} holds no result of motion-jax evaluate: it has no {', '.join(missing)}")
    # Other versions may have left a field out, or null.
    known = {name: value for name, value in data.items() if name in _FIELDS and value is not None}
    return cls(**{"title": data["protocol"]} | known, folder=folder)

  def write(self, folder) -> Self:
    """Writes results.json in a folder; returns the result with its folder."""
    with atomic_path(pathlib.Path(folder) / FILE) as path:
      path.write_text(json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return dataclasses.replace(self, folder=pathlib.Path(folder))

  @classmethod
  def read(cls, folder) -> Self:
    """The result that `motion-jax evaluate` wrote in a folder. Raises FileNotFoundError or ValueError if there is none.
    """
    folder = pathlib.Path(folder)
    if not (folder / FILE).is_file():
      raise FileNotFoundError(f"{folder}: no {FILE} there; expected the --out folder of motion-jax evaluate")
    return cls.from_json(checkpoint.load_json(folder, FILE), folder)


_REQUIRED = ("protocol", "rows", "row_order", "metrics")
_FIELDS = tuple(field.name for field in dataclasses.fields(Result) if field.name != "folder")
