"""What a study says: rows with intervals over seeds, claims with verdicts, as JSON and as tables beside the papers'.

  python benchmarks/study_report.py STUDY.json --registration FILE    judges a study.json again, from its rows
"""
import argparse
import collections
import json
import math
import pathlib
import sys

import numpy as np
import study_registration
import study_verdicts
from scipy.stats import t as student
from study_plan import TABLES, names_of

from motion_jax.evaluation.report import tables
from motion_jax.training import checkpoint

NOT_RUN = "not run"


def over_seeds(values) -> dict:
  """Mean of a number per seed, and half of its 95 % interval by Student's t; None of a single one."""
  values = np.asarray(values, np.float64)
  half = None
  if len(values) > 1:
    half = float(student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values)))
  return dict(mean=float(values.mean()), interval=half, values=values.tolist())


def effects_of(registration, numbers) -> list:
  """[(claim, effect or None, seeds, fewest seeds)]; numbers: {paper: {row: {seed: {metric: number}}}}.

  What counts is the difference of the two rows in each seed, which share batches, captions and noise.
  """
  effects = []
  for claim in registration.claims:
    a, b = ({seed: of[claim.metric] for seed, of in numbers.get(claim.source[0], {}).get(row, {}).items()
             if claim.metric in of} for row in (claim.a, claim.b))
    seeds = sorted(a.keys() & b.keys())
    effect = study_verdicts.over_seeds([a[seed] for seed in seeds], [b[seed] for seed in seeds],
                                       registration.settings["alpha"]) if seeds else None
    effects.append((claim, effect, len(seeds), registration.settings["fewest"]["seeds"]))
  return effects


def judged(effects, alpha) -> list[dict]:
  """Claims with their verdicts as plain values, from [(claim, effect or None, count of what it is over, the fewest that
  have a verdict)].

  Holm's correction is over all claims of the registration: one that was not run counts as a test that showed nothing.
  """
  corrected = study_verdicts.holm([effect.p if effect and count >= fewest else 1.0
                                   for _, effect, count, fewest in effects])
  rows = []
  for (claim, effect, count, fewest), p in zip(effects, corrected):
    if not count:
      verdict = study_verdicts.Verdict(study_verdicts.UNDECIDED, NOT_RUN)
    elif count < fewest:
      verdict = study_verdicts.Verdict(study_verdicts.UNDECIDED, f"{count} where {fewest} are registered")
    else:
      verdict = study_verdicts.judge(effect, claim.way, claim.margin, p, alpha)
    rows.append(dict(
        text=claim.text, source=list(claim.source), metric=claim.metric, a=claim.a, way=claim.way, b=claim.b,
        printed=list(claim.printed), margin=claim.margin, paper=claim.in_print, count=count,
        effect=effect and effect._asdict(), p_holm=float(p), verdict=verdict.verdict, remark=verdict.remark))
  return rows


def summarize(settings, scored, real, registration, kept=None) -> dict:
  """All results of a study, as plain values.

  settings: a dict; scored: the contents of scores.json files; real: {task: scores of real motions}; kept: as of
  `study_registration.keep`. Of folders only the names are kept: their contents are identified by hash, and their paths
  are private.
  """
  settings = settings | dict(archives=[pathlib.Path(folder).name for folder in settings["archives"]],
                             teacher=pathlib.Path(settings["teacher"]).name)
  rows = {}  # {paper: {row: {seed: content}}}, in the order of the tables
  for scores in sorted(scored, key=lambda scores: (names_of(scores["paper"]).index(scores["row"]), scores["seed"])):
    rows.setdefault(scores["paper"], {}).setdefault(scores["row"], {})[scores["seed"]] = scores
  commits = collections.Counter(str((scores.get("record") or {}).get("code")) for scores in scored)
  record = next((scores["record"] for scores in reversed(scored) if scores.get("record")), None)
  rows = {paper: {row: {seed: {key: value for key, value in scores.items() if key != "record"}
                        for seed, scores in of.items()}
                  for row, of in some.items()} for paper, some in rows.items()}
  return judge_again(dict(settings=settings, real=real, rows=rows, judged_by=dict(commits), record=record),
                     registration, kept)


def judge_again(study, registration, kept=None) -> dict:
  """A study with tables and claims computed from its rows."""
  numbers = {paper: {row: {seed: _means(scores) for seed, scores in of.items()} for row, of in some.items()}
             for paper, some in study["rows"].items()}
  table = {paper: {row: _row(of.values()) for row, of in some.items()} for paper, some in numbers.items()}
  claims = judged(effects_of(registration, numbers), registration.settings["alpha"])
  about = dict(registration=kept or dict(file=registration.path.name, sha256=registration.sha256),
               rules=registration.settings["rules"].strip(), alpha=registration.settings["alpha"])
  rest = {key: value for key, value in study.items() if key not in ("table", "claims", *about)}
  return rest | about | dict(
      table=table, claims=[scores for scores in claims if scores["source"][0] in study["settings"]["papers"]])


def _means(row):
  """{metric: mean over repeats} of what is finite, and the held-out numbers of the run that makes the motion."""
  held_out = {name: value for name, value in row["runs"][-1]["last"].items() if name.startswith("held_out")}
  return held_out | {metric: value["mean"] for metric, value in row["scores"].items()
                     if value["mean"] is not None and math.isfinite(value["mean"])}


def _row(of_seeds):
  of_seeds = list(of_seeds)
  metrics = dict.fromkeys(metric for numbers in of_seeds for metric in numbers)
  return {metric: over_seeds([numbers[metric] for numbers in of_seeds if metric in numbers]) for metric in metrics}


# --- Markdown ----------------------------------------------------------------------------------------------------


def markdown(study) -> str:
  """study.md."""
  settings = study["settings"]
  trained = {run["folder"].rpartition("/")[2] for run in _all_runs(study["rows"])} or settings["steps"]
  steps = ", ".join(f"{stage} {count}" for stage, count in settings["steps"].items() if stage in trained)
  parts = [
      "# The papers' ablations at small scale", "",
      "**Numbers under \"ours\" are of our own benchmark (CMU and Bandai archives, our evaluators, models of the size "
      f"{settings['size']!r}); numbers under \"paper\" are HumanML3D's, as printed. They stand beside each other to "
      "compare which row is better than which, never a number of ours with one of the paper's.**", "",
      f"Every row has the same steps ({steps}), data and batches. Each number of ours is a mean over up to "
      f"{settings['seeds']} seeds, of which each trains tokenizers of its own, ± half of the 95 % interval over seeds "
      f"(Student's t); {settings['repeats']} pass(es) over the test clips and {settings['stories']} stories of "
      f"{settings['segments']} prompts a seed. Real motions: one number each.", "",
      *(study_registration.lines(study["registration"]) if "commit" in study["registration"] else [
          f"Claims: `{study['registration']['file']}`."]), "", study["rules"]]
  parts += [line for note in study.get("notes", ()) for line in ("", f"**{note}**")]
  for source, names in TABLES.items():
    if any(row in study["table"].get(source[0], {}) for row in names):
      parts += ["", *_table(study, source, names)]
  parts += ["", *claims_section(study["claims"], study["alpha"]), "", *_runs(study["rows"]), "", *_judged_by(study)]
  return "\n".join(parts) + "\n"


def _table(study, source, names):
  """Lines of a printed table: our rows, then the same rows of the paper."""
  paper, table = source
  ours, printed = study["table"][paper], tables.paper_table(*source)
  metrics = [metric for metric in printed.metrics if any(metric in ours.get(row, {}) for row in names)]
  real = {metric: value for of in study["real"].values() for metric, value in of.items()}
  head = ["row", *(f"ours: {tables.heading(m)}" for m in metrics), *(f"paper: {tables.heading(m)}" for m in metrics),
          "seeds"]
  body = [["real", *(number(real.get(m) and {"mean": real[m]["mean"]}, m) for m in metrics), *[""] * len(metrics), ""]]
  for row, name in names.items():
    numbers, paper_row = ours.get(row, {}), printed.rows[name]
    seeds = max((len(value["values"]) for value in numbers.values()), default=0)
    body.append([f"{name} (`{row}`)", *(number(numbers.get(m), m) for m in metrics),
                 *(number(paper_row[m], m) for m in metrics), str(seeds)])
  return [f"## {paper.upper()}, rows of Table {table}", "", *grid(head, body)]


def number(value, metric):
  if not value or value.get("mean") is None:
    return "–"
  digits = value.get("digits", tables.METRICS[metric].digits if metric in tables.METRICS else 3)
  half = value.get("interval")
  return f"{value['mean']:.{digits}f}" + ("" if half is None else f" ± {half:.{digits}f}")


def claims_section(claims, alpha) -> list[str]:
  """Lines of the claims' table and of what the three verdicts mean."""
  names = (study_verdicts.SHOWN, study_verdicts.EXCLUDED, study_verdicts.UNDECIDED)
  count = collections.Counter(claim["verdict"] for claim in claims)
  opposite = sum(claim["remark"] == study_verdicts.OPPOSITE for claim in claims)
  percent = lambda value: f"{100 * value:+.1f}"
  body = []
  for claim in claims:
    sign = 1 if claim["way"] == "higher" else -1
    effect = claim["effect"]
    ours = "–" if not effect else f"{percent(effect['value'])} [{percent(effect['low'])}, {percent(effect['high'])}]"
    body.append([claim["text"], f"{claim['source'][0].upper()} {claim['source'][1]}", label(claim["metric"]),
                 f"`{claim['a']}` {claim['way']} than `{claim['b']}`",
                 percent(sign * claim["margin"]) + ("" if claim["printed"][0] == claim["metric"] else
                                                  f" (of {label(claim['printed'][0])})"),
                 ours, "–" if not effect else f"{claim['p_holm']:.3g}",
                 claim["verdict"] + (f" ({claim['remark']})" if claim["remark"] else "")])
  return ["## The papers' claims", "",
          f"Effects in per cent of the second row, with intervals at {100 * (1 - alpha):g} %; p by Holm's correction "
          f"over all claims. **Shown**: p is below {alpha:g} on the claimed side. **Excluded within the margin**: the "
          "interval ends before the paper's relative effect, so that an effect of its size is excluded at this scale. "
          "**Undecided**: neither. Intervals are not corrected for their number: if all effects were of the paper's "
          f"size, about one in {2 / alpha:g} would be excluded by chance. Of "
          f"{len(claims)} claims " + ", ".join(f"{count[name]} {name}" for name in names)
          + (f"; of {opposite} the opposite is shown" if opposite else "") + ".", "",
          *grid(["claim", "table", "metric", "rows", "paper, %", "ours, %", "p (Holm)", "verdict"], body)]


def label(metric):
  """The label of a metric, or its name, such as held_out_loss."""
  return tables.label(metric) if metric in tables.METRICS else metric.replace("_", " ")


def _runs(rows):
  """Held-out numbers of what was trained, which tell whether a row was trained at all."""
  body, seen = [], set()
  for run in _all_runs(rows):
    if run["folder"] not in seen:
      seen.add(run["folder"])
      last = ", ".join(f"{name} {value:.4g}" for name, value in run["last"].items()
                       if name == "loss" or name.startswith("held_out"))
      body.append([f"`{run['folder']}`", str(run["steps"]), last, f"{run['seconds'] / 60:.1f}"])
  return ["## What was trained", "", *grid(["run", "steps", "at the end", "minutes"], body)]


def _all_runs(rows):
  return [run for some in rows.values() for of in some.values() for row in of.values() for run in row["runs"]]


def _judged_by(study):
  """Which code the numbers are of; the record of the last row is in study.json."""
  lines = [f"- {count} rows by code {code}" for code, count in study["judged_by"].items()]
  if len(lines) > 1:
    lines.append("- **Not all by the same code: `study.py --again` evaluates again the rows of older code.**")
  return ["## What judged", "", *lines]


def grid(head, body):
  return ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|", *("| " + " | ".join(row) + " |" for row in body)]


def main(argv=None):
  parser = argparse.ArgumentParser(description="Judges a study again, from the rows in its JSON file.")
  parser.add_argument("study", type=pathlib.Path, help="a study.json, which is judged again and rewritten")
  parser.add_argument("--page", type=pathlib.Path, help="its Markdown page (default: the same name with .md)")
  parser.add_argument("--registration", required=True)
  args = parser.parse_args(argv)
  try:
    registration = study_registration.load(args.registration)
    study = json.loads(args.study.read_text(encoding="utf-8"))
    if not {"settings", "rows", "judged_by"} <= set(study):
      raise ValueError(f"{args.study} is no study.json of benchmarks/study.py, whose rows are judged here; studies of "
                       "sampling are judged by study_sampling.py --report")
    study = judge_again(study, registration)
  except OSError as error:
    sys.exit(f"study_report.py: cannot read {args.study} ({error.strerror}), expected a study.json")
  except ValueError as error:
    sys.exit(f"study_report.py: {error}")
  page = args.page or args.study.with_suffix(".md")
  checkpoint.save_text(args.study.parent, args.study.name, json.dumps(study, allow_nan=False) + "\n")
  checkpoint.save_text(page.parent, page.name, markdown(study))
  print(f"wrote {args.study}, {page}")


if __name__ == "__main__":
  main()
