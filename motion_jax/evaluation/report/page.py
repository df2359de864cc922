"""One page that shows evaluations: tables beside the paper's, curves, motions next to the real ones, the record.

`write(results, folder)` makes index.html, which loads nothing from anywhere, and motions/*.html, where the pairs play.
"""
import base64
import dataclasses
import html
import io
import json
import pathlib
import shutil
import tempfile

from PIL import Image

from motion_jax import charts, export
from motion_jax.data.clip import Caption
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import Result
from motion_jax.metrics.physics import IN_ROWS
from motion_jax.runtime.atomic import atomic_path

_STYLE = pathlib.Path(__file__).parent / "assets" / "report.css"
_GLANCE = ("fid", "top3", "matching", "clip_score", "diversity", "multimodality", "mpjpe", "transition_fid", "auj")
_TILES = 6
_SIDES = {"real": "real", "made": "generated"}
_STRIP = dict(num=6, height=230)
_TITLES = {"grid": ("Motions", "Real next to generated, same caption."),
           "failure": ("Failures", "The motions that are farthest from their words, by the evaluator.")}


def write(results, out, folders=None) -> pathlib.Path:
  """Writes out/index.html (and out/motions/) from results (`evaluation.result`); returns the page's path.

  folders: where each result's gallery files lie, to which their paths are relative; None: in out. A result that came
  without all of them has no pictures, and the page says so. Raises ValueError for no result, FileNotFoundError for a
  gallery of which a part is missing.
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
  text = _page(sections, results)
  with atomic_path(out / "index.html") as path:
    path.write_text(text, encoding="utf-8")
  return out / "index.html"


def write_folders(folders, out) -> pathlib.Path:
  """`write` of the results that `motion-jax evaluate` wrote in folders.

  Raises FileNotFoundError or ValueError for one without.
  """
  folders = [pathlib.Path(folder) for folder in folders]
  results = [Result.read(folder) for folder in folders]
  if len(results) > 1:  # several of one protocol have one title
    results = [dataclasses.replace(result, title=f"{name}: {_title(result)}")
               for name, result in zip(_apart(folders), results)]
  return write(results, out, folders)


def _apart(folders):
  """The last parts of paths, as many as tell all of them apart."""
  parts = [folder.resolve().parts for folder in folders]
  for count in range(1, max(map(len, parts)) + 1):
    names = ["/".join(part[-count:]) for part in parts]
    if len(set(names)) == len(names):
      break
  return names


def _page(sections, results):
  several = len(results) > 1
  title, about = ("Evaluation", "") if several else (_title(results[0]), f"<p>{_about(results[0])}</p>")
  if several:  # one result's title is the page's
    links = "".join(f'<a href="#r{i}">{_text(_title(result))}</a>' for i, result in enumerate(results))
    about = f"<nav>{links}</nav>"
    sections = [f"<h2>{_text(_title(result))}</h2><p class=\"note\">{_about(result)}</p>{section}"
                for result, section in zip(results, sections)]
  return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{_text(title)}</title>
<style>
{_STYLE.read_text(encoding="utf-8")}</style>
</head>
<body>
<main>
<header><h1>{_text(title)}</h1>{about}</header>
{"".join(f'<section id="r{i}">{section}</section>' for i, section in enumerate(sections))}
<footer>Made by motion_jax. This page loads nothing; keep its folder together to play the motions.</footer>
</main>
</body>
</html>
"""


def _section(name, result, folder, pages):
  found = tables.compare(result)
  parts = [_tiles(found), _tables(found),
           _sanity(result.sanity), _controls(result.controls), _curves(result.curves)]
  shown = result.gallery
  if shown and not any((folder / one[side]).is_file() for one in shown for side in _SIDES if one.get(side)):
    # Results are shared and committed without the motions, whose licence may forbid it.
    parts.append('<p class="note">results.json came without its gallery folder: no motions to show.</p>')
    shown = ()
  for kind in _TITLES:
    parts.append(_gallery(kind, [one for one in shown if one["kind"] == kind], folder, pages, f"{name}_{kind}"))
  parts.append(_record(result.provenance))
  return "\n".join(part for part in parts if part)


def _title(result):
  return result.title or result.protocol


def _about(result):
  """What to say of a result in a line: protocol, data, evaluator, repeats."""
  record = result.provenance
  data, evaluators = record.get("data") or {}, record.get("evaluators") or []
  facts = [f"protocol {result.protocol}"]
  if data.get("samples"):
    facts.append(f"{data['samples']:,} samples of {data.get('split', 'test')}")
  if evaluators:
    facts.append("judged by " + ", ".join(one["name"] for one in evaluators))
  if record.get("repeats"):
    facts.append(f"{record['repeats']} repeat{'s' if record['repeats'] > 1 else ''}")
  return _text(" · ".join(facts))


# --- numbers -----------------------------------------------------------------------------------------------------


def _tiles(found):
  """The first row of ours at a glance, with the real motions' and the paper's number under each; its name where there
  are others."""
  rows, several = {}, sum(line.kind == "ours" for line in found.lines) > 1
  for line in found.lines:
    rows.setdefault(line.kind, line)
  if "ours" not in rows:
    return ""
  tiles = []
  for metric in [name for name in _GLANCE if name in found.metrics][:_TILES]:
    at = found.metrics.index(metric)
    cell = rows["ours"].cells[at]
    others = [f"{name} {rows[kind].cells[at].mean}" for kind, name in (("real", "real"), ("paper", "paper"))
              if kind in rows and rows[kind].cells[at].mean != "–"]
    others = [_text(rows["ours"].name)] * several + others
    tiles.append(f'<div class="tile"><span class="what">{_text(tables.heading(metric))}</span><b>{cell.mean}'
                 f"{_mark(cell)}</b><span>{'<br>'.join(others)}</span></div>")
  return f'<div class="tiles">{"".join(tiles)}</div>'


def _tables(found):
  """The scores, and below them what bodies and feet do, so that either fits a page's width."""
  physics = [metric for metric in found.metrics if metric in IN_ROWS]
  metrics = [metric for metric in found.metrics if metric not in physics]
  body = f"<h3>Bodies and feet</h3>{_table(found, physics)}" if physics and metrics else ""
  notes = "".join(f"<li>{_text(note)}</li>" for note in found.notes)
  return _table(found, metrics or physics) + f'<ul class="notes">{notes}</ul>' + body


def _table(found, metrics):
  best = _best(found)
  rows = []
  for line in found.lines:
    cells = {metric: cell for metric, cell in zip(found.metrics, line.cells) if metric in metrics}
    if line.kind.startswith("paper") and all(cell.mean == "–" for cell in cells.values()):
      continue
    shown = "".join(f"<td>{_number(cell, (line.name, metric) in best)}</td>" for metric, cell in cells.items())
    rows.append(f'<tr class="{line.kind.replace(" ", "-")}"><th>{_text(line.name)}</th>{shown}</tr>')
  return _grid(_heads(metrics), rows)


def _number(cell, bold):
  mean = f"<b>{cell.mean}</b>" if bold else cell.mean
  return mean + (f"<small>±{cell.interval}</small>" if cell.interval else "") + _mark(cell)


def _mark(cell):
  return '<span class="mark">*</span>' if cell.marked else ""


def _best(found):
  """{(row, metric)}: the best number among several rows of ours, where it lies outside the interval of the next one.

  Rows of a part, as "suffix: ..", are compared among themselves.
  """
  real = next((line for line in found.lines if line.kind == "real"), None)
  parts, best = {}, set()
  for line in found.lines:
    if line.kind == "ours":
      parts.setdefault(line.name.partition(": ")[0] if ": " in line.name else "", []).append(line)
  for ours in parts.values():
    for at, metric in enumerate(found.metrics):
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


def _heads(metrics):
  """Header cells, arrows coloured."""
  return [f"<th>{_text(tables.label(metric))} <i>{tables.arrow(metric)}</i></th>" for metric in metrics]


def _grid(heads, rows):
  return ('<div class="card scroll"><table><thead><tr><th></th>' + "".join(heads) + "</tr></thead><tbody>"
          + "".join(rows) + "</tbody></table></div>")


def _sanity(found):
  """Real motions with their own and with shuffled captions: the evaluators have to tell them apart."""
  if not found:
    return ""
  real, shuffled = found.get("real") or {}, found.get("shuffled") or {}
  metrics = [name for name in real if name in shuffled and name in tables.METRICS]
  rows = [f"<tr><th>{name}</th>" + "".join(f"<td>{_plain(row[metric])}</td>" for metric in metrics) + "</tr>"
          for name, row in (("real motions", real), ("shuffled captions", shuffled))]
  verdict = _verdict(found.get("failures"), "The evaluators tell real motions from shuffled captions and from noise.")
  noise = found.get("fid_noise")
  halves = f", of two halves of the real motions {_plain(found['fid_halves'])}" if found.get("fid_halves") else ""
  said = f'<p class="note">FID of noise against real motions: {_plain(noise)}{halves}.</p>' if noise is not None else ""
  return "<h3>Sanity</h3>" + verdict + (_grid(_heads(metrics), rows) if metrics else "") + said


def _controls(found):
  """Damaged real motions: the way each number has to go, and whether it did."""
  if not found:
    return ""
  expected = found.get("expected") or []
  metrics = list(dict.fromkeys(one["metric"] for one in expected))
  rows = []
  for control in dict.fromkeys(one["control"] for one in expected):
    cells = {one["metric"]: one for one in expected if one["control"] == control}
    shown = "".join(f"<td>{_moved(cells[metric]) if metric in cells else ''}</td>" for metric in metrics)
    rows.append(f"<tr><th>{_text(control)}</th>{shown}</tr>")
  real = (found.get("rows") or {}).get("real")
  if real:
    rows.insert(0, '<tr class="real"><th>real</th>'
                + "".join(f"<td>{_plain(real.get(metric))}</td>" for metric in metrics) + "</tr>")
  verdict = _verdict(found.get("failures"), "Every number moves the way it should when real motions are damaged.")
  return "<h3>Controls</h3>" + verdict + _grid(_heads(metrics), rows)


def _moved(one):
  sign, ok = ("↑" if one["direction"] == "up" else "↓"), one["ok"]
  values = " → ".join(_plain(value) for value in one["values"])
  if one.get("noticed"):
    values += f' <small>from {100 * one["noticed"]:g} cm</small>'
  return f'{values} <span class="{"ok" if ok else "bad"}">{sign}{"✓" if ok else "✗"}</span>'


def _verdict(failures, good):
  if not failures:
    return f'<p><span class="ok">✓</span> {good}</p>'
  return '<div class="card alert">' + "".join(f"<p>✗ {_text(failure)}</p>" for failure in failures) + "</div>"


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
  figures = [f'<figure class="card"><figcaption>{_text(title)}</figcaption>{_legend(series)}'
             f"{charts.svg(series, x_label, y_label, title)}</figure>"
             for (title, x_label, y_label), series in lines.items()]
  return f'<h3>Curves</h3><div class="charts">{"".join(figures)}</div>' if figures else ""


def _legend(series):
  """The names of several lines with their colours; nothing for a single nameless one."""
  if len(series) < 2 or not any(one.name for one in series):
    return ""
  items = "".join(f'<li><svg viewBox="0 0 24 8" aria-hidden="true"><path class="line {kind}" d="M1 4H23"/></svg>'
                  f"{_text(one.name)}</li>" for one, kind in zip(series, charts.kinds(series)))
  return f'<ul class="legend">{items}</ul>'


def _gallery(kind, entries, folder, pages, stem):
  if not entries:
    return ""
  pairs = []
  for number, entry in enumerate(entries):
    clips = {side: _load(folder, entry[side]) for side in ("real", "made") if entry.get(side)}
    name = f"{stem}_{number:02d}.html"
    named = [clip.replace(captions=(Caption(f"{_SIDES[side]}: {entry['caption']}"),)) for side, clip in clips.items()]
    export.html(named, pages / name, title=entry["caption"])
    labels = "".join(f'<span style="top:calc({100 * row // len(clips)}% + 8px)">{_SIDES[side]}</span>'
                     for row, side in enumerate(clips))
    score = f' <span class="score">distance {entry["score"]:.2f}</span>' if entry.get("score") is not None else ""
    pairs.append(f'<div class="card pair"><p>{_text(entry["caption"])}{score}</p><div>'
                 f'<img src="{_strip(list(clips.values()))}" alt="{_text(entry["caption"])}">{labels}</div>'
                 f'<a href="motions/{name}">▶ play side by side</a></div>')
  title, said = _TITLES[kind]
  rows = dict.fromkeys(entry["row"] for entry in entries if entry.get("row"))
  said += f" Generated: {_text(', '.join(rows))}." if rows else ""
  return f'<h3>{title}</h3><p class="note">{said}</p><div class="pairs">{"".join(pairs)}</div>'


def _load(folder, name):
  path = pathlib.Path(folder) / name
  if not path.is_file():
    raise FileNotFoundError(f"the gallery names {name}, which is not in {folder}; keep results.json and its gallery "
                            "folder together, or evaluate again")
  return export.load(path)


def _strip(clips):
  """Moments of clips, a row each, as a picture inside the page."""
  with tempfile.TemporaryDirectory() as scratch:
    path = export.strip(clips, pathlib.Path(scratch) / "strip.png", caption="", **_STRIP)
    with Image.open(path) as image, io.BytesIO() as out:
      image.convert("RGB").save(out, "JPEG", quality=86, optimize=True)
      return "data:image/jpeg;base64," + base64.b64encode(out.getvalue()).decode("ascii")


# --- the record --------------------------------------------------------------------------------------------------


def _record(record):
  """What lets anyone repeat it: the facts that matter most, and all of it as JSON."""
  if not record:
    return ""
  facts = []
  for one in record.get("models") or ():
    facts.append(("model", _join(one, ("row", "model", "hash", "parameters", "layout", "guidance_scale", "sampler",
                                        "sampling"))))
  for one in record.get("evaluators") or ():
    facts.append(("evaluator", _join(one, ("name", "kind", "layout", "hash", "statistics"))))
  facts.append(("data", _join(record.get("data"), ("folders", "format", "split", "samples", "split_hash", "excluded"))))
  facts.append(("seed", record.get("seed")))
  facts += [(name, _join(record.get(name), None)) for name in ("precision", "device", "code", "versions")]
  items = "".join(f"<dt>{_text(name)}</dt><dd>{_text(value)}</dd>" for name, value in facts if value not in (None, ""))
  text = json.dumps(record, indent=1, ensure_ascii=False)
  return (f'<h3>Record</h3><div class="card"><dl class="facts">{items}</dl><details><summary>all of it</summary>'
          f"<pre>{_text(text)}</pre></details></div>")


def _join(values, names):
  """"name value · name value" of a dictionary, hashes shortened; names None: all of it."""
  if not isinstance(values, dict):
    return values
  chosen = {name: values.get(name) for name in (values if names is None else names)}
  return " · ".join(f"{name} {_short(name, value)}" for name, value in chosen.items() if value not in (None, {}, []))


def _short(name, value):
  if isinstance(value, dict):
    return ", ".join(f"{key} {one}" for key, one in value.items())
  if isinstance(value, list):
    return ", ".join(map(str, value))
  return str(value)[:12] if "hash" in name or name in ("statistics", "commit") else value


def _plain(value):
  return "–" if value is None else f"{value:.3f}" if abs(value) >= 0.01 or value == 0 else f"{value:.2g}"


def _text(value):
  return html.escape(str(value), quote=True)
