"""Writes docs/performance.md and its plots from the files that benchmarks/all.sh measured.

  python benchmarks/performance_page.py OUT PAGE      OUT: folder of the measurements; PAGE: such as docs/performance.md

A part whose measurements are missing says so. Plots are SVG files in a folder with the page's name, made by
motion_jax.charts.
"""
import argparse
import html
import json
import os
import pathlib
import re
import textwrap

import machine  # like results, roofline and time_to_motion a file beside this one
import numpy as np
import results
import roofline
import time_to_motion

from motion_jax import charts, look
from motion_jax.charts import Series
from motion_jax.utils.atomic import atomic_path

# charts.svg leaves colours to a page's style sheet; a file of its own brings them, for light and dark pages.
STYLE = """<style>text{font:12px sans-serif;fill:#667085}.grid{stroke:#667085;stroke-opacity:.2}
.axis,.border{stroke:#667085}.line{fill:none;stroke-width:2}.dot{stroke:none}.band{fill-opacity:.17}""" + "".join(
    f".line.{kind}{{stroke:{color}}}.dot.{kind},.band.{kind},text.{kind}{{fill:{color}}}"
    for kind, color in look.LIGHT.items() if re.fullmatch(r"s\d", kind)
) + "</style>"
MISSING = "Not measured yet: `benchmarks/all.sh` measures it."


def plot(folder, name, series, x_label, y_label, logarithmic=False) -> str:
  """Writes an SVG file with a legend -> the Markdown that shows it; "" without points."""
  series = [line for line in series if len(line.x)]
  if not series:
    return ""
  drawn = charts.svg(series, x_label, y_label, f"{y_label} against {x_label}", logarithmic)
  place = lambda i: f'x="{76 + 130 * (i % 3)}" y="{charts.HEIGHT + 14 + 16 * (i // 3)}"'
  legend = "".join(f'<text class="{kind}" {place(i)}>{html.escape(line.name)}</text>'
                   for i, (line, kind) in enumerate(zip(series, charts.kinds(series))))
  height = charts.HEIGHT + 8 + 16 * -(-len(series) // 3)
  drawn = re.sub(r'viewBox="[^"]*"', f'viewBox="0 0 {charts.WIDTH} {height}" width="{charts.WIDTH}"', drawn, count=1)
  drawn = drawn.replace("</svg>", legend + "</svg>").replace("\n", "\n" + STYLE + "\n", 1)
  folder.mkdir(parents=True, exist_ok=True)
  with atomic_path(folder / f"{name}.svg") as whole:
    whole.write_text(drawn + "\n")
  return f"![{y_label} against {x_label}](PLOTS/{name}.svg)"


def by_model(rows):
  """{model: its rows}, of rows named kind/MODEL/number, in rising order of the number."""
  rows_of = {}
  for row in sorted(rows, key=lambda row: float(row["piece"].split("/")[2])):
    if "error" not in row:
      rows_of.setdefault(row["piece"].split("/")[1], []).append(row)
  return rows_of


def waiting(out, plots) -> str:
  path = out / "time_to_motion.json"
  if not path.exists():
    return MISSING
  measured = json.loads(path.read_text())
  kinds = [kind for kind, row in measured["rows"].items() if row.get("cold")]
  places = list(range(1, len(kinds) + 1))
  seconds = [Series(name, places, values) for name, values in (
      ("cold", [measured["rows"][kind]["cold"]["processor"] for kind in kinds]),
      ("warm", [time_to_motion.median(measured["rows"][kind]["warm"], "processor") for kind in kinds]))]
  shown = plot(plots, "time-to-motion", seconds, "request: " + ", ".join(
      f"{i} {kind}" for i, kind in zip(places, kinds)), "processor seconds", logarithmic=True)
  before = out / "before.json"
  compared = "\n\n" + time_to_motion.comparison(json.loads(before.read_text()), measured) if before.exists() else ""
  longest = sorted(((seconds, name, kind) for kind, row in measured["rows"].items()
                    for name, seconds in row.get("cold", {}).get("longest", [])), reverse=True)[:8]
  log = "Longest compilations: " + ", ".join(f"`{name}` {seconds:.1f} s ({kind})" for seconds, name, kind in longest)
  return f"{time_to_motion.table(measured)}\n\n{log or ''}.{compared}\n\n{shown}"


def lengths(rows, plots) -> str:
  chosen = by_model(results_of(rows, "length"))
  if not chosen:
    return MISSING
  lines, series = [], []
  for model, of_model in chosen.items():
    x, y = ([row[key] for row in of_model] for key in ("length", "processor"))
    slope = float(np.polyfit(x, y, 1)[0]) if len(x) > 1 else y[0] / x[0]
    series.append(Series(model, [seconds / 60 for seconds in x], y))
    lines += [[model, row["length"], row["processor"], row["seconds"], 1000 * row["processor"] / row["length"],
               row["fps"], megabytes(row["working_mb"]), remark(row)] for row in of_model]
    lines.append([model, "slope", "", "", 1000 * slope, "", "", "least squares"])
  shown = plot(plots, "length", series, "minutes of motion", "processor seconds")
  return results.markdown(["model", "motion, s", "processor s", "s", "processor ms per second of motion", "frames/s",
                           "working MB", "remark"], lines) + f"\n\n{shown}"


def batches(rows, plots) -> str:
  chosen = by_model(results_of(rows, "batch"))
  if not chosen:
    return MISSING
  lines, series = [], []
  for model, of_model in chosen.items():
    series.append(Series(model, [row["batch"] for row in of_model], [row["fps"] for row in of_model]))
    lines += [[model, row["batch"], row["fps"], row["fps"] / of_model[0]["fps"], row["processor"], row["seconds"],
               megabytes(row["working_mb"], row["batch"]), remark(row)] for row in of_model]
  shown = plot(plots, "batch", series, "clips at once", "frames a second", logarithmic=True)
  return results.markdown(["model", "clips at once", "frames/s", f"times batch {of_model[0]['batch']}", "processor s",
                           "s", "working MB a clip", "remark"], lines) + f"\n\n{shown}"


def streaming(rows, plots) -> str:
  chosen, parts = by_model(results_of(rows, "streams")), []
  if not chosen:
    return MISSING
  series = [Series(model, [row["streams"] for row in of_model], [row["fps"] / 20 / row["streams"] for row in of_model])
            for model, of_model in chosen.items()]
  parts.append(results.markdown(
      ["model", "streams", "frames/s, all", "each, times real time", "ms a block", "remark"],
      [[model, row["streams"], row["fps"], row["fps"] / 20 / row["streams"], 1000 * row["block_seconds"], remark(row)]
       for model, of_model in chosen.items() for row in of_model]))
  parts.append(plot(plots, "streams", series, "streams in turn", "each, times real time"))
  for model, of_model in by_model(results_of(rows, "endless")).items():
    minutes = of_model[-1]["by_minute"]
    picked = [minutes[i] for i in sorted({0, len(minutes) // 2, len(minutes) - 1})]
    table = results.markdown(["minute", "ms a block", "held MB"],
                             [[minute, 1000 * block, held or ""] for minute, block, held in picked])
    parts.append(f"{of_model[-1]['minutes']} minutes of one stream of {model}, as fast as it goes:\n\n{table}")
    parts.append(plot(plots, f"endless-{model}", [Series(model, [row[0] for row in minutes],
                                                         [1000 * row[1] for row in minutes])],
                      "minute of the stream", "ms a block"))
  return "\n\n".join(filter(None, parts))


def ratios(rows) -> str:
  chosen = [row for row in results_of(rows, "plain") if "error" not in row]
  return results.markdown(
      ["size", "sampler, processor s", "plain loop, processor s", "times faster", "remark"],
      [[row["piece"].split("/")[1], row["processor"], row["plain_processor"], row["ratio"], remark(row)]
       for row in chosen]) if chosen else MISSING


def computed(rows, gpus, plots) -> str:
  """Tables of the roofline and its plot: what each device can reach at an intensity, and where the programs stand.

  gpus: files of what was measured on a device.
  """
  if not rows:
    return MISSING
  tenths = np.arange(0, 40) / 10
  series = [Series(device.name, tenths, np.minimum(device.half, 10 ** tenths * device.bandwidth) / 1e12)
            for device in roofline.DEVICES if device.name != "H200 SXM"]
  h100 = roofline.DEVICES[0]
  for row in rows:
    if row["piece"] in ("stream/M/bfloat16", "train/denoiser-M/bfloat16/batch256"):
      series.append(Series(row["piece"].replace("/bfloat16", ""), [np.log10(row["flops"] / row["bytes"])],
                           [row["flops"] / roofline.bare(row, h100) / 1e12]))
  shown = plot(plots, "roofline", series, "log10 of operations per byte", "bfloat16 TFLOP/s", logarithmic=True)
  return f"{roofline.tables(rows, roofline.measurements(gpus))}\n\n{shown}"


def results_of(rows, kind):
  return [row for row in rows if row["piece"].startswith(f"{kind}/")]


def megabytes(growth, clips=1):
  """The memory (MB) of each clip; "" where the process did not grow, or released more than it took."""
  return growth / clips if growth and growth > 0 else ""


def remark(row):
  return machine.mark(row.get("others"))


def page(out, plots) -> str:
  rows, training, peers = results.read(out / "rows.jsonl"), out / "training.md", out / "peers.md"
  first = next((row for row in rows if "machine" in row), None)
  where = (f"{machine.words(first['machine'])}; jax {first['jax']}, commit {first['commit']}, {first['date']}."
           if first else "No machine yet.")
  gpus = sorted((out.parent / "gpu").glob("*.jsonl"))
  links = ", ".join(f"[{path.stem}](benchmark/gpu/{path.stem}/README.md)" for path in gpus)
  method = " ".join(roofline.__doc__.split("\n\n")[2].split()).replace(
      "the time of a kernel launch", f"{1e6 * roofline.LAUNCH:g} microseconds, the time of a kernel launch,")
  method = textwrap.fill(method, 120, break_on_hyphens=False)
  parts = {
      "": f"""Measured by one command, `benchmarks/all.sh`, which writes this page (`--quick`: a shorter list in about
eight minutes). Rows that exist are kept: to measure one again, delete its line in `benchmarks/data/performance`.
Seconds are medians; processor seconds count user and system time of all cores. Rows during which other work used more
than {machine.QUIET:g} cores are marked: compare their processor seconds, not their seconds on the clock.

Machine: {where}
Earlier measurements are in the [lab notebook](lab/speed.md).""",
      "Time to motion": f"""Requests on the command line, each in a process of its own. Cold: the cache of programs was
empty before the first row, and later rows share it. Warm: all programs are cached.

{waiting(out, plots)}""",
      "Cost against length": f"One clip in one call, one pass, all compiled.\n\n{lengths(rows, plots)}",
      "Batches": f"""Clips of 6 s at once. M is the paper's size with random weights.

{batches(rows, plots)}""",
      "Streams": f"Streams that take turns in one process.\n\n{streaming(rows, plots)}",
      "The sampler compared with a plain loop": f"""Clips of 6 s, latents only, 50 steps, guidance 3, random weights;
the plain loop recomputes every latent in every step.

{ratios(rows)}""",
      "Training compared with PyTorch": (
          f"```text\n{training.read_text().strip()}\n```" if training.exists() else MISSING),
      "Generation compared with the authors' code": f"""`benchmarks/method_peers.py`: a clip of 6 s by the authors'
own PyTorch code and by ours, random weights of the released sizes, on one core, without text encoders and decoders of
latents. `--list` names the repositories, their commits and how to fetch them; their code is not part of this library.

{peers.read_text().strip() if peers.exists() else "Not measured yet: it needs the authors' repositories."}""",
      "GPUs and TPUs": f"""The least time of each program is *computed*; the last column is what `benchmarks/gpu.sh`
measured on the available devices: {links or 'none yet'}.

{method}

{computed(results.read(out / "roofline.jsonl"), gpus, plots)}""",
  }
  return "# Performance\n\n" + "\n\n".join(f"## {title}\n\n{text}" if title else text for title, text in parts.items())


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("page", type=pathlib.Path)
  args = parser.parse_args()
  plots = args.page.with_suffix("")
  text = page(args.out, plots).replace("PLOTS", os.path.relpath(plots, args.page.parent))
  with atomic_path(args.page) as whole:
    whole.write_text(text + "\n")
  print(f"wrote {args.page}")


if __name__ == "__main__":
  main()
