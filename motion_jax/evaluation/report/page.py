"""The HTML page of evaluations: tables next to the papers', curves, motions next to the real ones, provenance.

`write(results, folder)` creates index.html, which loads nothing from elsewhere, and motions/*.html, where the pairs
play. The content is collected here; assets/report.html is its template, which escapes all text, with a style sheet.
"""
import base64
import dataclasses
import io
import json
import pathlib
import re
import shutil
import tempfile

import jinja2
from PIL import Image

from motion_jax import charts, export, look
from motion_jax.data.clip import Caption
from motion_jax.evaluation.report import differences, tables
from motion_jax.evaluation.result import Result
from motion_jax.metrics.physics import IN_ROWS
from motion_jax.motion import plausibility
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError

_ASSETS = pathlib.Path(__file__).parent / "assets"
_GLANCE = ("fid", "top3", "matching", "clip_score", "diversity", "multimodality", "mpjpe", "transition_fid", "auj")
_TILES = 6
_SIDES = {"real": "real", "made": "generated"}
_STRIP = dict(num=6, height=230)
_TITLES = {"grid": ("Motions", "Real next to generated, same caption."),
           "failure": ("Failures", "The motions that are farthest from their words, by the evaluator.")}


def write(results, out, folders=None) -> pathlib.Path:
  """Writes out/index.html (and out/motions/) from results (`evaluation.result`); returns the page's path.

  folders: the folder of each result's gallery files; None: out. For a result without any of them the page says that it
  has no pictures. Raises ValueError for no results, FileNotFoundError for an incomplete gallery.
  """
  results = [results] if isinstance(results, Result) else list(results)
  if not results:
    raise ValueError("got no result to report; motion-jax evaluate writes results.json")
  out = pathlib.Path(out)
  folders = [out] * len(results) if folders is None else [pathlib.Path(folder) for folder in folders]
  if len(folders) != len(results):
    raise ValueError(f"got {len(folders)} folders for {len(results)} results")
  with tempfile.TemporaryDirectory() as scratch:
    pages = pathlib.Path(scratch)
    sections = [_section(f"r{i}", result, folder, pages) for i, (result, folder) in enumerate(zip(results, folders))]
    for page in sorted(pages.iterdir()):
      with atomic_path(out / "motions" / page.name) as path:
        shutil.copyfile(page, path)
  text = _template().render(sections=sections, style=look.page_style())
  with atomic_path(out / "index.html") as path:
    path.write_text(text, encoding="utf-8")
  return out / "index.html"


def write_folders(folders, out) -> pathlib.Path:
  """`write` for the results that `motion-jax evaluate` wrote in folders.

  Raises FileNotFoundError or ValueError for a folder without one.
  """
  folders = [pathlib.Path(folder) for folder in folders]
  results = [Result.read(folder) for folder in folders]
  if len(results) > 1:  # several of one protocol have one title
    results = [dataclasses.replace(result, title=f"{name}: {_title(result)}")
               for name, result in zip(_apart(folders), results)]
  return write(results, out, folders)


def _apart(folders):
  """The last parts of paths, as many as needed to distinguish them."""
  parts = [folder.resolve().parts for folder in folders]
  for count in range(1, max(map(len, parts)) + 1):
    names = ["/".join(part[-count:]) for part in parts]
    if len(set(names)) == len(names):
      break
  return names


def _template():
  pages = jinja2.Environment(loader=jinja2.FileSystemLoader(_ASSETS), autoescape=True, undefined=jinja2.StrictUndefined,
                             trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
  pages.filters |= {"label": tables.label, "arrow": tables.arrow, "heading": tables.heading, "short": _short}
  return pages.get_template("report.html")


def _section(name, result, folder, pages):
  """The section of a result; pages: a folder for the page of each pair of motions."""
  table = tables.compare(result)
  physics = [metric for metric in table.metrics if metric in IN_ROWS]
  metrics = [metric for metric in table.metrics if metric not in physics]
  shown = result.gallery
  # Results are shared and committed without the motions, whose licence may forbid it.
  lost = bool(shown) and not any(
      (folder / motion[side]).is_file() for motion in shown for side in _SIDES if motion.get(side))
  chosen = {} if lost else {kind: [motion for motion in shown if motion["kind"] == kind] for kind in _TITLES}
  # Bodies and feet stand below the scores, so that either fits a page's width.
  return {"title": _title(result), "about": _about(result), "tiles": _tiles(table), "notes": table.notes,
          "scores": _scores(table, metrics or physics),
          "physics": _scores(table, physics) if physics and metrics else None,
          "differences": [_differences(comparison) for comparison in differences.comparisons(result)],
          "sanity": _sanity(result.sanity), "controls": _controls(result.controls),
          "curves": _curves(result.curves), "without_motions": lost,
          "galleries": [_gallery(kind, entries, folder, pages, f"{name}_{kind}") for kind, entries in chosen.items()
                        if entries],
          "provenance": _provenance(result.provenance)}


def _title(result):
  return result.title or result.protocol


def _about(result):
  """A result in one line: protocol, data, evaluator, replications."""
  provenance = result.provenance
  data, evaluators = provenance.get("data") or {}, provenance.get("evaluators") or []
  facts = [f"protocol {result.protocol}"]
  if data.get("samples"):
    facts.append(f"{data['samples']:,} samples of {data.get('split', 'test')}")
  if evaluators:
    facts.append("judged by " + ", ".join(evaluator["name"] for evaluator in evaluators))
  if count := provenance.get("replications"):
    facts.append(f"{count} replication{'s' if count > 1 else ''}")
  return " · ".join(facts)


# --- numbers -----------------------------------------------------------------------------------------------------


def _tiles(table):
  """Key numbers of our first row, with those of the real motions and the paper under each, and its name if there are
  others.
  """
  rows, several = {}, sum(line.kind == "ours" for line in table.lines) > 1
  for line in table.lines:
    rows.setdefault(line.kind, line)
  if "ours" not in rows:
    return []
  tiles = []
  for metric in [name for name in _GLANCE if name in table.metrics][:_TILES]:
    at = table.metrics.index(metric)
    others = [f"{kind} {rows[kind].cells[at].mean}" for kind in ("real", "paper")
              if kind in rows and rows[kind].cells[at].mean != "–"]
    tiles.append({"metric": metric, "cell": rows["ours"].cells[at], "others": [rows["ours"].name] * several + others})
  return tiles


def _scores(table, metrics):
  """The table of some metrics, without rows of the paper that have none of them."""
  best = _best(table)
  rows = []
  for line in table.lines:
    cells = {metric: cell for metric, cell in zip(table.metrics, line.cells) if metric in metrics}
    if line.kind.startswith("paper") and all(cell.mean == "–" for cell in cells.values()):
      continue
    rows.append({"kind": line.kind.replace(" ", "-"), "name": line.name,
                 "cells": [(cell, (line.name, metric) in best) for metric, cell in cells.items()]})
  return {"metrics": metrics, "rows": rows}


def _differences(table):
  """A table of differences, without a best number."""
  return {"title": table.title, "notes": table.notes, "metrics": table.metrics,
          "rows": [{"kind": line.kind, "name": line.name, "cells": [(cell, False) for cell in line.cells]}
                   for line in table.lines]}


def _best(table):
  """{(row, metric)}: the best number among several rows of ours, where it lies outside the interval of the next one.

  Rows of a part, as "suffix: ..", are compared among themselves.
  """
  real = next((line for line in table.lines if line.kind == "real"), None)
  parts, best = {}, set()
  for line in table.lines:
    if line.kind == "ours":
      parts.setdefault(line.name.partition(": ")[0] if ": " in line.name else "", []).append(line)
  for ours in parts.values():
    for at, metric in enumerate(table.metrics):
      better = tables.METRICS[metric].better if metric in tables.METRICS else ""
      cells = {line.name: line.cells[at] for line in ours if line.cells[at].mean != "–"}
      goal = real.cells[at].mean if real else "–"
      if len(cells) < 2 or not better or (better == "real" and goal == "–"):
        continue
      cost = {"up": lambda v: -v, "down": lambda v: v, "real": lambda v, goal=goal: abs(v - float(goal))}[better]
      costs = {name: cost(float(cell.mean)) for name, cell in cells.items()}
      first, second = sorted(costs, key=costs.get)[:2]
      width = max(float(cells[name].interval or 0) for name in (first, second))
      if costs[second] - costs[first] > width:
        best.add((first, metric))
  return best


def _sanity(record):
  """Scores of real motions with their own and with shuffled captions, which the evaluators have to separate."""
  if not record:
    return None
  real, shuffled = record.get("real") or {}, record.get("shuffled") or {}
  return {"metrics": [name for name in real if name in shuffled and name in tables.METRICS],
          "rows": [("real motions", real), ("shuffled captions", shuffled)], "failures": record.get("failures"),
          "noise": record.get("fid_noise"), "halves": record.get("fid_halves")}


def _controls(record):
  """Damaged real motions: the direction in which each number has to move, and whether it did."""
  if not record:
    return None
  rows = {}
  for expectation in record.get("expected") or []:
    noticed = f"{100 * expectation['noticed']:g}" if expectation.get("noticed") else None
    rows.setdefault(expectation["control"], {})[expectation["metric"]] = expectation | {"noticed": noticed}
  return {"metrics": list(dict.fromkeys(metric for cells in rows.values() for metric in cells)), "rows": rows,
          "real": (record.get("rows") or {}).get("real"), "failures": record.get("failures")}


# --- pictures ----------------------------------------------------------------------------------------------------


def _curves(curves):
  """Charts of curves {name: {"x", "y", "interval", "x_label", "y_label"}}; "chart, line": lines of one chart.

  A line called "real" is drawn as the level to reach.
  """
  lines = {}
  for name, curve in (curves or {}).items():
    title, _, line = name.partition(", ")
    lines.setdefault((title, curve["x_label"], curve["y_label"]), []).append(
        charts.Series(line, curve["x"], curve["y"], curve.get("interval"), line == "real"))
  return [{"title": title, "svg": charts.svg(series, x_label, y_label, title),
           "legend": _legend(series)} for (title, x_label, y_label), series in lines.items()]


def _legend(series):
  """[(name, colour's class)] of several lines; empty for a single line or for lines without names."""
  if len(series) < 2 or not any(line.name for line in series):
    return []
  return [(line.name, kind) for line, kind in zip(series, charts.kinds(series))]


def _gallery(kind, entries, folder, pages, stem):
  pairs = []
  for number, entry in enumerate(entries):
    clips, notes = _drawable(folder, entry)
    name = f"{stem}_{number:02d}.html" if clips else None
    named = [clip.replace(captions=(Caption(f"{_SIDES[side]}: {entry['caption']}"),)) for side, clip in clips.items()]
    if named:
      export.html(named, pages / name, title=entry["caption"])
    picture = _strip(list(clips.values())) if clips else None
    pairs.append({"caption": entry["caption"], "score": entry.get("score"), "page": name, "notes": notes,
                  "picture": picture, "sides": [_SIDES[side] for side in clips]})
  title, said = _TITLES[kind]
  rows = list(dict.fromkeys(entry["row"] for entry in entries if entry.get("row")))
  return {"title": title, "said": said, "rows": rows, "pairs": pairs}


def _drawable(folder, entry):
  """({side: clip} of an entry, notes): the sample of a barely trained model may have an implausible skeleton, or one
  that cannot be drawn."""
  clips, notes = {}, []
  for side, said in _SIDES.items():
    if not entry.get(side):
      continue
    try:
      clip = _load(folder, entry[side])
      if fault := plausibility.fault(clip.joints, clip.skeleton, clip.fps, said):
        export.page(clip)  # raises for bones that are too long for a body
    except InputError as error:
      notes.append(f"{said}: not drawn: {_reason(error)}")
      continue
    clips[side] = clip
    if fault:
      notes.append(_reason(fault))
  return clips, notes


def _reason(error):
  """The cause in an error's text, without the path at its start and the advice at its end."""
  return re.sub(r"^\S*\.npz: ", "", str(error)).partition(";")[0]


def _load(folder, name):
  path = pathlib.Path(folder) / name
  if not path.is_file():
    raise FileNotFoundError(f"the gallery names {name}, which is not in {folder}; keep results.json and its gallery "
                            "folder together, or evaluate again")
  return export.load(path, check=False)


def _strip(clips):
  """Moments of clips, a row each, as a picture embedded in the page."""
  with tempfile.TemporaryDirectory() as scratch:
    path = export.strip(clips, pathlib.Path(scratch) / "strip.png", caption="", **_STRIP)
    with Image.open(path) as image, io.BytesIO() as out:
      image.convert("RGB").save(out, "JPEG", quality=86, optimize=True)
      return "data:image/jpeg;base64," + base64.b64encode(out.getvalue()).decode("ascii")


# --- provenance ---------------------------------------------------------------------------------------------------


def _provenance(provenance):
  """The most important facts of the provenance, and all of it as JSON."""
  if not provenance:
    return None
  facts = []
  for model in provenance.get("models") or ():
    facts.append(("model", _join(model, ("row", "model", "hash", "parameters", "layout", "guidance_scale", "sampler",
                                        "sampling"))))
  for evaluator in provenance.get("evaluators") or ():
    facts.append(("evaluator", _join(evaluator, ("name", "kind", "layout", "hash", "statistics"))))
  facts.append(("data", _join(provenance.get("data"),
                              ("folders", "format", "split", "samples", "split_hash", "excluded"))))
  facts.append(("seed", provenance.get("seed")))
  facts += [(name, _join(provenance.get(name), None)) for name in ("precision", "device", "code", "versions")]
  return {"facts": [(name, value) for name, value in facts if value not in (None, "")],
          "whole": json.dumps(provenance, indent=1, ensure_ascii=False)}


def _join(values, names):
  """"name value · name value" of a dictionary, hashes shortened; names None: all of it."""
  if not isinstance(values, dict):
    return values
  chosen = {name: values.get(name) for name in (values if names is None else names)}
  return " · ".join(f"{name} {_told(name, value)}" for name, value in chosen.items() if value not in (None, {}, []))


def _told(name, value):
  if isinstance(value, dict):
    return ", ".join(f"{key} {item}" for key, item in value.items())
  if isinstance(value, list):
    return ", ".join(map(str, value))
  return str(value)[:12] if "hash" in name or name in ("statistics", "commit") else value


def _short(value):
  return "–" if value is None else f"{value:.3f}" if abs(value) >= 0.01 or value == 0 else f"{value:.2g}"
