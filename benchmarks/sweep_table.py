"""One table of the methods that a sweep trains: scores, physics, speed and behaviour, at any moment of the training.

  python benchmarks/sweep_table.py same_data runs/same-data --data path/to/cmu path/to/cmu2 path/to/bandai \
      --page docs/lab/same-data-same-budget.md [--only mdm mld] [--parts trained speed evaluation behaviour]

Each method is measured as it is now: its last stage is the model, in one pass of the network, without plan, cleanup or
further attempts. Measurements are rows of WORKDIR/table/rows.jsonl, named after the method and the step of its
model: the same command continues where it was stopped, and measures again what was trained further. The table is
written into the page between its markers. `evaluation` is what `motion-jax evaluate --protocol
archives-66 --no-multimodality` measures; WORKDIR/table/index.html is its report of all methods. `speed` is one motion
of six seconds at a time, compiled before it is timed; a method that does not stream has its first frame with its last.
`behaviour` applies the rules of benchmarks/behaviour.py to one motion of each sentence.
"""
import argparse
import pathlib
import re
import statistics
import time

import behaviour  # like machine and results a file beside this one
import jax
import machine
import numpy as np
import results
import sweep
from behaviour_sentences import sentences

from motion_jax import loading, runs
from motion_jax.evaluation import run as evaluation
from motion_jax.evaluation.report import page, tables
from motion_jax.evaluation.request import Request
from motion_jax.training.saver import progress
from motion_jax.utils.errors import InputError
from motion_jax_studio import Pipeline, steps

FRAMES, PROMPT, ROUNDS = 120, "a person walks forward", 5
SCORES = ("top1", "top3", "fid", "matching", "skating", "jerk")
PARTS = ("trained", "speed", "evaluation", "behaviour")
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"


def trained(stages, workdir) -> dict:
  """Steps and processor seconds of each stage, and the parameters of the networks that make a motion."""
  progress_of = {stage: progress(workdir / stage) for stage in stages}
  model = loading.load(workdir / stages[-1])
  return dict(stages={stage.partition("/")[2]: dict(steps=step, cpu_seconds=spent) for stage, (step, spent)
                      in progress_of.items()},
              cpu_seconds=sum(spent for _, spent in progress_of.values()), parameters=model.num_params)


def speed(folder, rounds=ROUNDS) -> dict:
  """Frames a second of a single clip and milliseconds to the first frame, medians; processor seconds of a clip."""
  model = loading.load(folder)

  def clip(seed):
    return jax.block_until_ready(model.generate([PROMPT], num_frames=FRAMES, seeds=[seed]).joints)

  def first(seed):
    if not model.can("stream"):
      return clip(seed)
    return jax.block_until_ready(next(model.stream(PROMPT, seed=seed)))

  wall, processor, waits = [], [], []
  for seed in range(rounds + 1):
    with machine.cost() as cost:
      clip(seed)
    began = time.perf_counter()
    first(seed)
    if seed:  # the first round compiles
      wall.append(cost.wall)
      processor.append(cost.processor)
      waits.append(1000 * (time.perf_counter() - began))
  return dict(frames_per_second=FRAMES / statistics.median(wall), first_frame_ms=statistics.median(waits),
              processor_seconds=statistics.median(processor), streams=model.can("stream"))


def evaluate(folder, data, out, replications, limit=None) -> dict:
  """{row: {metric: mean and interval}} of real motions and the model."""
  result = evaluation.evaluate(Request([folder], data, protocol="archives-66", clip_evaluator="none",
                                      replications=replications, limit=limit, multimodality=False, out=out))
  real, model = result.row_order[:2]
  return dict(rows={"real": result.rows[real], "model": result.rows[model]}, result=str(out))


def behave(folder, seeds=1, most=None) -> dict:
  """Motions that do what their sentence says, of how many, for each category; speed of planted feet in m/s."""
  pipeline = Pipeline(folder, steps=[steps.Sample()])
  pipeline.warns = False
  rows = behaviour.judge(pipeline, list(sentences())[:most], seeds)
  categories = {}
  for row in rows:
    good, number = categories.get(row["category"], (0, 0))
    categories[row["category"]] = good + sum(row["passed"]), number + len(row["passed"])
  return dict(passed=sum(good for good, _ in categories.values()), motions=sum(n for _, n in categories.values()),
              categories=categories, planted=float(np.mean([speed for row in rows for speed in row["planted"]])))


def wanted(methods, workdir, out, args) -> dict:
  """{piece: function that measures it}, part by part, so that a table of all methods is there early."""
  pieces = {}
  of_part = {
      "trained": lambda stages, model: trained(stages, workdir),
      "speed": lambda stages, model: speed(model),
      "evaluation": lambda stages, model: evaluate(model, args.data, out / f"{model.parent.name}-{progress(model)[0]}",
                                                   args.replications, args.limit),
      "behaviour": lambda stages, model: behave(model, args.seeds, args.limit)}
  for part in args.parts:
    for method, stages in methods.items():
      model = workdir / stages[-1]
      if progress(model)[0] and (not args.only or method in args.only):
        pieces[f"{method}/{part}/{progress(model)[0]}"] = lambda part=part, stages=stages, model=model: of_part[part](
            stages, model)
  return pieces


def newest(out, methods, workdir) -> dict:
  """{method: {part: measurement}} of the models as they are now; an earlier one where that is still to be made."""
  by_method = {method: {} for method in methods}
  for row in sorted(results.read(out / "rows.jsonl"), key=lambda row: int(row["piece"].rpartition("/")[2])):
    method, part, _ = row["piece"].split("/")
    if method in by_method and "error" not in row:
      by_method[method][part] = row
  return by_method


def number(value, digits=3) -> str:
  if not value or value.get("mean") is None:
    return "–"
  half = value.get("interval")
  return f"{value['mean']:.{digits}f}" + ("" if half is None else f" ± {half:.{digits}f}")


def markdown(by_method) -> str:
  """The tables of scores, speed and budget, and of behaviour by category."""
  digits = {metric: tables.METRICS[metric].digits for metric in SCORES}
  scores = []
  real = next((parts["evaluation"]["rows"]["real"] for parts in by_method.values() if "evaluation" in parts), None)
  if real:
    scores.append(["real motions", *(number(real.get(metric), digits[metric]) for metric in SCORES), "–"])
  for method, parts in by_method.items():
    row = parts.get("evaluation", {}).get("rows", {}).get("model", {})
    rules = parts.get("behaviour")
    scores.append([method, *(number(row.get(metric), digits[metric]) for metric in SCORES),
                   f"{rules['passed']} of {rules['motions']}, {100 * rules['passed'] / rules['motions']:.0f} %"
                   if rules else "–"])
  heads = [f"{tables.heading(metric)}" for metric in SCORES]
  lines = [results.markdown(["method", *heads, "sentences followed ↑"], scores), "", "± is half of the 95 % interval "
           "over the replications.", ""]
  cost = []
  for method, parts in by_method.items():
    about, fast = parts.get("trained"), parts.get("speed")
    cost.append([
        method, f"{about['parameters'] / 1e6:.2f}" if about else "–",
        f"{about['cpu_seconds']:.0f}" if about else "–",
        ", ".join(f"{name} {stage['steps']} ({stage['cpu_seconds']:.0f} s)" for name, stage in about["stages"].items())
        if about else "–",
        *([f"{fast['frames_per_second']:.0f}", f"{fast['processor_seconds']:.3f}", f"{fast['first_frame_ms']:.0f}",
           "yes" if fast["streams"] else "no", machine.mark(fast.get("others"))] if fast else ["–"] * 5)])
  lines += [results.markdown(["method", "parameters, M", "processor s of training", "steps of each stage",
                              "frames a second, one clip of 6 s", "processor s of a clip", "ms to the first frame",
                              "streams", "remark"], cost), ""]
  categories = list(dict.fromkeys(name for parts in by_method.values() for name in parts.get("behaviour", {}).get(
      "categories", ())))
  lines.append(results.markdown(["category", *by_method], [
      [name, *(" of ".join(map(str, parts["behaviour"]["categories"][name])) if "behaviour" in parts else "–"
               for parts in by_method.values())] for name in categories]) if categories else "")
  return "\n".join(lines).rstrip() + "\n"


def write_page(path, text):
  """Replaces what stands between the markers of a page."""
  before = path.read_text(encoding="utf-8")
  if before.count(BEGIN) != 1 or before.count(END) != 1 or before.index(BEGIN) > before.index(END):
    raise InputError(f"{path} lacks the lines {BEGIN} and {END}, between which the table is written; add them")
  replaced = re.sub(f"{BEGIN}.*{END}", lambda _: f"{BEGIN}\n{text}{END}", before, flags=re.DOTALL)
  path.write_text(replaced, encoding="utf-8")


def report(out, methods, workdir, page_file) -> str:
  """Writes the page and the HTML report of all evaluations; returns the Markdown."""
  by_method = newest(out, methods, workdir)
  measured = [row for parts in by_method.values() for row in parts.values()]
  about = sorted({f"{row['date']}, commit {row['commit']}, {row['machine']}" for row in measured})
  text = "\n".join([*(f"{line}." for line in about), "", markdown(by_method)])
  if page_file:
    write_page(page_file, text)
  shown = [pathlib.Path(parts["evaluation"]["result"]) for parts in by_method.values() if "evaluation" in parts]
  if all((folder / "results.json").is_file() for folder in shown) and shown:
    page.write_folders(shown, out)
  return text


def parse(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  add = parser.add_argument
  add("sweep", help="name or file of the sweep, as for benchmarks/sweep.py")
  add("workdir", type=pathlib.Path, help="its --workdir")
  add("--data", nargs="+", help="data folders, whose test split is evaluated")
  add("--page", type=pathlib.Path, help="Markdown page with the markers, which gets the table")
  add("--only", nargs="+", help="methods to measure (default: all that have a model)")
  add("--parts", nargs="*", choices=PARTS, default=PARTS, help="what to measure; nothing: only write the table")
  add("--replications", type=int, default=5)
  add("--seeds", type=int, default=1, help="motions of each sentence")
  add("--limit", type=int, help="test clips and sentences of a trial")
  add("--seconds", type=float, default=1e9, help="begin no measurement after this time")
  args = parser.parse_args(argv)
  if "evaluation" in args.parts and not args.data:
    parser.error("evaluation needs --data")
  return args


def main(argv=None):
  args = parse(argv)
  methods = sweep.methods_of(sweep.load(args.sweep))
  out = args.workdir / (f"table-{args.limit}" if args.limit else "table")  # a trial is no measurement
  device = "" if jax.default_backend() == "cpu" else f", {jax.devices()[0].device_kind}"
  about = dict(date=machine.today(), commit=machine.commit(runs.PRETRAINED),
               machine=machine.words(machine.describe()) + device)
  rows = out / "rows.jsonl"
  results.keep(rows, [row for row in results.read(rows) if "error" not in row])  # pieces that failed are tried again
  pieces = wanted(methods, args.workdir, out, args)
  done = results.measure(rows, pieces, args.seconds, about | {"others": machine.load()})
  print(report(out, methods, args.workdir, args.page))
  return 0 if done else 1


if __name__ == "__main__":
  raise SystemExit(main())
