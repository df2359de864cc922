"""Tables with the papers' numbers next to ours: all numbers of both papers as data; output as Markdown, LaTeX and CSV.

`paper_tables/` holds a JSON file for each printed table: `"0.588 ± 0.004"` is a mean and its 95 % interval as printed,
null a number that is not given. A number of ours that differs from the paper's by more than either interval is marked.
"""
import csv as csv_lib
import dataclasses
import functools
import io
import json
import pathlib
from typing import NamedTuple

from motion_jax.evaluation.report import notes as said
from motion_jax.evaluation.result import HALVES, Result

REAL = "GT"  # the papers' name for the row of real motions


class Metric(NamedTuple):
  """Presentation of a number; better: "up", "down", "real" (close to the real motions' number) or "" (neither)."""
  label: str
  better: str
  digits: int = 3


METRICS = {
    "top1": Metric("R@1", "up"), "top2": Metric("R@2", "up"), "top3": Metric("R@3", "up"),
    "fid": Metric("FID", "down"), "fid_unit": Metric("FID, unit vectors", "down"),
    "kid": Metric("KID", "down"),
    "matching": Metric("MM-Dist", "down"), "multimodality": Metric("MModality", "up"),
    "diversity": Metric("Diversity", "real"), "clip_score": Metric("CLIP-score", "up"),
    "reconstruction_fid": Metric("rec. FID", "down"), "mpjpe": Metric("MPJPE", "down"),
    "mpjpe_heading": Metric("MPJPE with heading", "down"), "released_mpjpe": Metric("MPJPE (released code)", "down"),
    "transition_fid": Metric("transition FID", "down"), "transition_kid": Metric("transition KID", "down"),
    "transition_diversity": Metric("transition Div.", "real"),
    "peak_jerk": Metric("PJ", "real", 4), "auj": Metric("AUJ", "down"),
    "transition_distance": Metric("transition dist.", "down", 4),
    "crop_top1": Metric("crop R@1", "up"), "crop_top3": Metric("crop R@3", "up"),
    "tmr_m2t": Metric("TMR M2T", "up"), "tmr_m2m": Metric("TMR M2M", "up"),
    "trajectory_20": Metric("traj. err. 20 cm", "down"), "trajectory_50": Metric("traj. err. 50 cm", "down"),
    "location_20": Metric("loc. err. 20 cm", "down"), "location_50": Metric("loc. err. 50 cm", "down"),
    "control_error": Metric("avg. err., m", "down", 4), "top_speed": Metric("top speed, m/s", "real", 1),
    "skating": Metric("skating", "real"), "planted_speed": Metric("planted feet, m/s", "real"),
    "foot_height": Metric("foot height", "real", 4),
    "penetration": Metric("penetration", "real", 4), "bone_drift": Metric("bone drift", "real", 4),
    "slide": Metric("slide, m a frame", "real", 4),
    "acceleration": Metric("acceleration", "real"), "jerk": Metric("jerk", "real", 4),
    "largest_jerk": Metric("peak jerk", "real", 3),
    "auc_jerk": Metric("AUC jerk", "real", 2), "auc_dynamics": Metric("AUC dynamics", "real", 2),
    "auc_limbs": Metric("AUC limbs", "real", 2),
    "preference": Metric("preferred", "up"), "frames_per_second": Metric("frames/s", "up", 1),
    "first_token_ms": Metric("first latent, ms", "down", 1), "next_token_ms": Metric("next latent, ms", "down", 1),
    "parameters_million": Metric("parameters, M", "", 1),
}
ARROWS = {"up": "↑", "down": "↓", "real": "→", "": ""}
_LATEX_ARROWS = {"up": r"$\uparrow$", "down": r"$\downarrow$", "real": r"$\rightarrow$", "": ""}


@dataclasses.dataclass(frozen=True)
class PaperTable:
  """One printed table; rows: {row name: {metric: {"mean", "interval" or None, "digits" as printed}}}, None unprinted.

  own: the paper's own models among the rows, groups: the kinds of the others. protocols: {benchmark whose numbers the
  table prints: {metric there: metric here}}, empty if no benchmark of ours measures them. Numbers are in our units:
  where the paper prints percent or centimetres, `unit` says so. source: the table and the lines of its text.
  """
  system: str
  table: str
  title: str
  caption: str
  dataset: str
  protocols: dict
  repeats: int | None
  source: str
  metrics: tuple[str, ...]
  rows: dict
  own: tuple[str, ...] = ()
  notes: tuple[str, ...] = ()
  unit: dict = dataclasses.field(default_factory=dict)
  groups: dict = dataclasses.field(default_factory=dict)
  details: dict = dataclasses.field(default_factory=dict)

  @property
  def judged(self) -> bool:
    """Whether a benchmark of ours measures the table's numbers."""
    return bool(self.protocols)

  def row_for(self, row, protocol) -> dict[str, dict]:
    """The numbers of a row that a protocol measures, {metric there: number}; for another protocol all of them."""
    names = self.protocols.get(protocol) or {metric: metric for metric in self.metrics}
    return {there: self.rows[row][here] for there, here in names.items() if self.rows[row][here] is not None}


@functools.cache
def paper_tables() -> dict[tuple[str, str], PaperTable]:
  """All printed tables, {(system, table): PaperTable}; system is "cmdm" or "cdamd", table its number: "1", "2", ..; or
  "authors", of the further methods, each row from its own paper; or "control".

  CMDM's Table 3 is two, "3-humanml3d" and "3-snapmogen"; "speed" holds the timings that its text states.
  """
  folder = pathlib.Path(__file__).parent / "paper_tables"
  tables = [_read(path) for path in sorted(folder.glob("*.json"))]
  if not tables:
    raise FileNotFoundError(f"{folder} holds no tables; the package is not installed as a whole, install it again")
  return {(table.system, table.table): table for table in tables}


def paper_table(system, table) -> PaperTable:
  """One printed table, by system and number."""
  tables = paper_tables()
  key = str(system).lower(), str(table)
  if key not in tables:
    known = ", ".join(f"{a} {b}" for a, b in tables)
    raise ValueError(f"got table {table!r} of {system!r}, expected one of {known}")
  return tables[key]


def paper_row(system, table, row) -> dict[str, dict]:
  """A printed row, {metric: {"mean": .., "interval": .. or None, "digits": ..}}; metrics not printed are left out."""
  printed = paper_table(system, table)
  if row not in printed.rows:
    raise ValueError(f"got row {row!r} of {system}'s table {table}, expected one of {', '.join(printed.rows)}")
  return {metric: value for metric, value in printed.rows[row].items() if value is not None}


def _read(path):
  data = json.loads(path.read_text(encoding="utf-8"))
  scale = data.pop("scale", {})
  unknown = set(data["metrics"]) - set(METRICS)
  if unknown:
    raise ValueError(f"{path.name} has the metrics {', '.join(sorted(unknown))}, which METRICS does not name")
  rows = {}
  for name, cells in data.pop("rows").items():
    if len(cells) != len(data["metrics"]):
      raise ValueError(f"{path.name}, row {name!r}: got {len(cells)} numbers for {len(data['metrics'])} metrics")
    rows[name] = {metric: _number(cell, scale.get(metric, 1)) for metric, cell in zip(data["metrics"], cells)}
  protocols = data.pop("protocols", None)
  if protocols is None:
    protocols = {data.pop("protocol"): data["metrics"]}
  data["protocols"] = {name: metrics if isinstance(metrics, dict) else {metric: metric for metric in metrics}
                       for name, metrics in protocols.items()}
  lists = {key: tuple(data[key]) for key in ("metrics", "own", "notes") if key in data}
  return PaperTable(**data | lists, rows=rows)


def _number(printed, scale):
  if printed is None:
    return None
  mean, _, interval = printed.partition(" ± ")
  digits = len(mean.partition(".")[2]) + {1: 0, 0.01: 2}[scale]
  return {"mean": round(float(mean) * scale, 6), "interval": round(float(interval) * scale, 6) if interval else None,
          "digits": digits}


class Cell(NamedTuple):
  """A number as shown: text of mean and interval (either may be ""), and whether it is marked."""
  mean: str
  interval: str = ""
  marked: bool = False


class Line(NamedTuple):
  """A row as shown; kind: "real", "halves" of the real motions, "ours", "paper" or "paper real"."""
  name: str
  kind: str
  cells: list[Cell]


class Comparison(NamedTuple):
  """A result next to the paper's rows, independent of the output format."""
  title: str
  metrics: list[str]
  lines: list[Line]
  notes: list[str]


def compare(result: Result) -> Comparison:
  """The rows of a result, then the paper's.

  result.paper names the printed rows: {"system", "table", "row", "also", "unmarked"}. row: a name, or {row of ours:
  name or [{"system", "table", "row"}, ..]}; "also" lists further rows to show, names of that table or [system, table,
  name]. Rows of ours under "unmarked" are shown next to theirs without marks. Where the table has several rows of a
  name, as "suffix: CDAMD", a row "suffix: .." of ours is compared with it. None: no rows of a paper.
  """
  metrics, paper = list(result.metrics), result.paper
  against, printed, notes = ({}, {}, []) if paper is None else _printed(result, paper)
  lines = []
  names = list(result.row_order)
  if HALVES in result.rows and "real" in names:
    names.insert(names.index("real") + 1, HALVES)
  for name in names:
    kind = {"real": "real", HALVES: "halves"}.get(name, "ours")
    cells = [_cell(metric, result.rows[name].get(metric), against.get(name, {})) for metric in metrics]
    lines.append(Line(name, kind, cells))
  for name, row in printed.items():
    kind = "paper real" if name == REAL else "paper"
    lines.append(Line(f"paper: {'real' if name == REAL else name}", kind, [_paper_cell(row.get(m)) for m in metrics]))
  notes = [*said.of(result, label), *notes]
  if any(cell.marked for line in lines for cell in line.cells):
    notes.append("* differs from the paper's number by more than either 95 % interval.")
  return Comparison(result.title or result.protocol, metrics, lines, notes)


def printed_table(system, table) -> Comparison:
  """A whole table of a paper, for `markdown(printed_table("cmdm", "1"))`."""
  printed = paper_table(system, table)
  lines = [Line(name, "paper real" if name == REAL else "paper",
                [_paper_cell(row[metric]) for metric in printed.metrics])
           for name, row in printed.rows.items()]
  repeats = f"mean ± 95 % interval of {printed.repeats} repeats" if printed.repeats else "as printed"
  units = [f"{METRICS[metric].label}: {unit}." for metric, unit in printed.unit.items()]
  notes = [f"{printed.source}; {repeats}.", *units, *(f"{note[0].upper()}{note[1:]}." for note in printed.notes)]
  return Comparison(f"{printed.system.upper()}, Table {printed.table}: {printed.title}", list(printed.metrics), lines,
                    notes)


def _printed(result, paper):
  """({row of ours: the paper's numbers that it is compared with}, the paper's rows to show, {name: row}, the real one
  last, and notes on them).
  """
  main = paper["system"], str(paper["table"])
  partners, unmarked = _partners(result, paper["row"], paper_table(*main)), set(paper.get("unmarked", ()))
  also = [(*main, entry) if isinstance(entry, str) else tuple(entry) for entry in paper.get("also", ())]
  elsewhere = [entry for entry in also if not paper_table(*entry[:2]).judged]
  wanted = [entry for some in partners.values() for entry in some] + [entry for entry in also if entry not in elsewhere]
  shown, repeated = {}, []
  for key in dict.fromkeys(wanted):
    numbers = paper_table(*key[:2]).row_for(key[2], result.protocol)
    same = key[:2] != main and any(_repeats(numbers, other) for other in shown.values())
    repeated += [key] * same
    shown |= {} if same else {key: numbers}
  against = {}
  for name, keys in partners.items():
    if name not in unmarked:
      for key in reversed(keys):  # the first one counts most
        against[name] = against.get(name, {}) | paper_table(*key[:2]).row_for(key[2], result.protocol)
  real = {}
  if REAL in paper_table(*main).rows:
    real = {REAL: paper_table(*main).row_for(REAL, result.protocol)}
    against |= {"real": real[REAL]} if "real" not in unmarked else {}
  name_of = lambda key: key[2] if key[:2] == main else f"{key[2]} ({_table_name(key, main)})"
  rows = {name_of(key): numbers for key, numbers in shown.items() if key[2] != REAL} | real
  notes = []
  for key in dict.fromkeys([*(key[:2] for key in shown), *([main] if real else [])]):
    notes += _said_of(paper_table(*key))
  if repeated:
    notes.append(f"In print, too, with the same numbers: {', '.join(map(name_of, repeated))}.")
  for key in elsewhere:
    notes.append(f"In print of this model, too: {_in_words(key)}.")
  names = [name for name in partners if name in unmarked]
  if names:
    notes.append("Not the paper's model as it was printed, or not its whole test set, so never marked: "
                 f"{', '.join(names)}.")
  return against, rows, notes


def _table_name(key, main=("", "")):
  system = "" if key[0] == main[0] else f"{key[0].upper()} "
  number = key[1].partition("-")[0]
  return f"{system}Table {number}" if number.isdigit() else f"{system}{number}"


def _said_of(table):
  """The introduction of a table's rows."""
  repeats = f"mean ± 95 % interval of {table.repeats} repeats" if table.repeats else "as printed"
  name = _table_name((table.system, table.table), (table.system,))
  return [f"Rows of the paper: {table.system.upper()}, {name} ({table.title}); {repeats}.",
          *(f"Paper: {note}." for note in table.notes)]


def _in_words(key):
  """A row of a table that no benchmark of ours measures, as a clause."""
  table = paper_table(*key[:2])
  numbers = (f"{label(metric)} {_paper_cell(value).mean}" for metric, value in table.rows[key[2]].items() if value)
  return f"{key[2]}, {', '.join(numbers)} ({key[0].upper()}, {_table_name(key, key)}: {table.title})"


def _repeats(numbers, others):
  """Whether all numbers occur among others, ignoring intervals that only one of them has."""
  return all(metric in others and value["mean"] == others[metric]["mean"] and (
      None in (value["interval"], others[metric]["interval"]) or value["interval"] == others[metric]["interval"])
             for metric, value in numbers.items())


def _partners(result, row, table) -> dict[str, list]:
  """{row of ours: [(system, table, row of the paper), ..]}"""
  key = table.system, table.table
  if isinstance(row, dict):
    return {name: [(*key, partner)] if isinstance(partner, str) else [
        (each["system"], each["table"], each["row"]) for each in partner] for name, partner in row.items()}
  ours = [name for name in result.row_order if name != "real"]
  if any(name.endswith(f": {row}") for name in table.rows):
    parts = {name: f"{name.partition(': ')[0]}: {row}" for name in ours}
    return {name: [(*key, part)] for name, part in parts.items() if part in table.rows}
  return {name: [(*key, row)] for name in ours}


def differs(ours, paper) -> bool:
  """Whether two numbers {"mean", "interval"} are further apart than the wider of both intervals.

  A printed number is known to half a unit of its last digit only, so that much always counts as agreement.
  """
  rounding = 0.5 * 10.0 ** -paper.get("digits", 3)
  width = max(ours.get("interval") or 0.0, paper.get("interval") or 0.0, rounding)
  return abs(ours["mean"] - paper["mean"]) > width + 1e-12


def _cell(metric, value, against):
  if value is None or value.get("mean") is None:
    return Cell("–")
  digits = METRICS[metric].digits if metric in METRICS else 3
  known, interval = against.get(metric), value.get("interval")
  compared = known is not None and (interval is not None or known["interval"] is not None)
  return Cell(f"{value['mean']:.{digits}f}", f"{interval:.{digits}f}" if interval is not None else "",
              compared and differs(value, known))


def _paper_cell(value):
  if value is None:
    return Cell("–")
  show = lambda number: f"{number:.{value['digits']}f}"
  return Cell(show(value["mean"]), "" if value["interval"] is None else show(value["interval"]))


def label(metric) -> str:
  """A metric's name in a table."""
  return METRICS[metric].label if metric in METRICS else metric.replace("_", " ")


def arrow(metric, arrows=ARROWS) -> str:
  """The direction that is better: "↑", "↓", "→" (closer to the real motions), or ""."""
  return arrows[METRICS[metric].better if metric in METRICS else ""]


def heading(metric) -> str:
  """"FID ↓": label and arrow."""
  return f"{label(metric)} {arrow(metric)}".strip()


def markdown(result: Result | Comparison) -> str:
  """A result, or a Comparison, as Markdown, aligned so that it reads in a terminal, with notes below."""
  table = result if isinstance(result, Comparison) else compare(result)
  body = [[line.name, *(_plain(cell) for cell in line.cells)] for line in table.lines]
  head = ["", *(heading(metric) for metric in table.metrics)]
  widths = [max(len(row[i]) for row in [head, *body]) for i in range(len(head))]
  show = lambda row: "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths)) + " |"
  rule = "| " + " | ".join("-" * width for width in widths) + " |"
  lines = [f"### {table.title}", "", show(head), rule, *map(show, body), "", *(f"- {note}" for note in table.notes)]
  return "\n".join(lines).replace("- * ", "- \\* ") + "\n"


def latex(result: Result | Comparison) -> str:
  """The same as a LaTeX table environment (booktabs), intervals as superscripts."""
  table = result if isinstance(result, Comparison) else compare(result)
  head = " & ".join(["", *(f"{_escape(label(metric))} {arrow(metric, _LATEX_ARROWS)}".strip()
                           for metric in table.metrics)])
  rows, before = [], None
  for line in table.lines:
    if before is not None and line.kind.startswith("paper") != before.startswith("paper"):
      rows.append(r"\midrule")
    rows.append(" & ".join([_escape(line.name), *map(_latex_cell, line.cells)]) + r" \\")
    before = line.kind
  notes = " ".join(_escape(note) for note in table.notes)
  return "\n".join([r"\begin{table}", r"\centering", rf"\begin{{tabular}}{{l{'c' * len(table.metrics)}}}", r"\toprule",
                    head + r" \\", r"\midrule", *rows, r"\bottomrule", r"\end{tabular}",
                    rf"\caption{{{_escape(table.title)}. {notes}}}", r"\end{table}"]) + "\n"


def csv(result: Result | Comparison) -> str:
  """The same as CSV: two columns, mean and interval, for each metric, empty where there is no number."""
  table = result if isinstance(result, Comparison) else compare(result)
  out = io.StringIO()
  writer = csv_lib.writer(out, lineterminator="\n")
  writer.writerow(["row", "kind", *(f"{metric}{end}" for metric in table.metrics for end in ("", "_interval"))])
  for line in table.lines:
    numbers = (text for cell in line.cells for text in (cell.mean.replace("–", ""), cell.interval))
    writer.writerow([line.name, line.kind, *numbers])
  return out.getvalue()


def _plain(cell):
  return cell.mean + (f" ± {cell.interval}" if cell.interval else "") + ("*" if cell.marked else "")


def _latex_cell(cell):
  if cell.mean == "–":
    return "--"
  interval = rf"^{{\pm {cell.interval}}}" if cell.interval else ""
  return f"${cell.mean}{interval}$" + ("*" if cell.marked else "")


_ESCAPES = str.maketrans({"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$",
                          "{": r"\{", "}": r"\}", "^": r"\^{}", "~": r"\~{}", "±": r"$\pm$", "–": "--",
                          "→": r"$\rightarrow$"})


def _escape(text):
  return text.translate(_ESCAPES)
