"""What a study says: rows with intervals over seeds, claims with verdicts, as JSON and as tables beside the papers'."""
import collections
import math
import pathlib
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student
from study_plan import TABLES, names_of

from motion_jax.evaluation.report import tables

SHOWS, DOES_NOT, OPPOSITE = "shows", "does not show", "the opposite shows"
ONE_SEED, NOT_RUN = "no verdict: one seed", "no verdict: not run"


class Claim(NamedTuple):
  """`metric` of row `a` is `way` ("lower" or "higher") than that of row `b`; source is (paper, printed table)."""
  text: str
  source: tuple[str, str]
  metric: str
  a: str
  way: str
  b: str


_CMDM, _LEVELS, _MASKS, _PARTS = ("cmdm", "4"), ("cdamd", "1"), ("cdamd", "4"), ("cdamd", "5")
CLAIMS = (
    Claim("alignment with a teacher lowers FID", _CMDM, "fid", "default", "lower", "c-vae"),
    Claim("alignment with a teacher raises R@1", _CMDM, "top1", "default", "higher", "c-vae"),
    Claim("alignment with a teacher lowers the FID of transitions", _CMDM, "transition_fid", "default", "lower",
          "c-vae"),
    Claim("a causal tokenizer lowers FID", _CMDM, "fid", "c-vae", "lower", "vae"),
    Claim("a causal tokenizer raises R@1", _CMDM, "top1", "c-vae", "higher", "vae"),
    Claim("a causal tokenizer lowers the FID of transitions", _CMDM, "transition_fid", "c-vae", "lower", "vae"),
    Claim("a causal tokenizer lowers AUJ", _CMDM, "auj", "c-vae", "lower", "vae"),
    Claim("one level for the whole sequence raises AUJ", _CMDM, "auj", "one-level", "higher", "default"),
    Claim("one level for the whole sequence raises the FID of transitions", _CMDM, "transition_fid", "one-level",
          "higher", "default"),
    Claim("AdaLN lowers FID", _CMDM, "fid", "default", "lower", "no-adaln"),
    Claim("AdaLN lowers AUJ", _CMDM, "auj", "default", "lower", "no-adaln"),
    Claim("rotary positions lower FID", _CMDM, "fid", "default", "lower", "no-rope"),
    Claim("rotary positions lower AUJ", _CMDM, "auj", "default", "lower", "no-rope"),
    Claim("without AdaLN and rotary positions FID is higher", _CMDM, "fid", "no-adaln-no-rope", "higher", "default"),
    Claim("without AdaLN and rotary positions the FID of transitions is higher", _CMDM, "transition_fid",
          "no-adaln-no-rope", "higher", "default"),
    Claim("frame-wise sampling has a lower FID than AR", _CMDM, "fid", "default", "lower", "ar"),
    Claim("frame-wise sampling has a higher R@1 than AR", _CMDM, "top1", "default", "higher", "ar"),
    Claim("frame-wise sampling has a lower AUJ than AR", _CMDM, "auj", "default", "lower", "ar"),
    Claim("of 50 steps a lag of 5 has a lower AUJ than one of 2", _CMDM, "auj", "fss-50-5", "lower", "default"),
    Claim("of 50 steps a lag of 10 has a higher FID than one of 2", _CMDM, "fid", "fss-50-10", "higher", "default"),
    Claim("50 steps have a lower FID than 20 at lag 5", _CMDM, "fid", "fss-50-5", "lower", "fss-20-5"),
    Claim("50 steps have a lower FID than 20 at lag 10", _CMDM, "fid", "fss-50-10", "lower", "fss-20-10"),
    Claim("two VQ levels have a lower FID than one", _LEVELS, "fid", "default", "lower", "one-vq"),
    Claim("all VQ levels have a lower R@1 than two", _LEVELS, "top1", "all-vq", "lower", "default"),
    Claim("one VQ level has the better matching than two", _LEVELS, "matching", "one-vq", "lower", "default"),
    Claim("CDAMD has a lower FID than MARDM", _LEVELS, "fid", "one-vq", "lower", "mardm"),
    Claim("CDAMD has a higher R@1 than MARDM", _LEVELS, "top1", "one-vq", "higher", "mardm"),
    Claim("DCCM has a lower FID than BCM", _MASKS, "fid", "one-vq", "lower", "bcm"),
    Claim("DCCM has a lower FID than the causal mask", _MASKS, "fid", "one-vq", "lower", "cm"),
    Claim("BCM has a lower FID than the causal mask", _MASKS, "fid", "bcm", "lower", "cm"),
    Claim("BCM has the better matching than DCCM", _MASKS, "matching", "bcm", "lower", "one-vq"),
    Claim("DCCM has a higher R@1 than the causal mask", _MASKS, "top1", "one-vq", "higher", "cm"),
    Claim("without the prior FID is worse", _PARTS, "fid", "no-prior", "higher", "one-vq"),
    Claim("without the prior matching is worse", _PARTS, "matching", "no-prior", "higher", "one-vq"),
    Claim("without the prior FID is worse on 263 features, too", _PARTS, "fid", "263-no-prior", "higher", "263"),
    Claim("without dual-constrained attention FID is worse on 263 features, too", _PARTS, "fid", "263-no-dcca",
          "higher", "263"),
    Claim("coordinates have a lower FID than 263 features", _PARTS, "fid", "one-vq", "lower", "263"),
    Claim("263 features have the better matching than coordinates", _PARTS, "matching", "263", "lower", "one-vq"),
)


def over_seeds(values) -> dict:
  """Mean of a number per seed, and half of its 95 % interval by Student's t; None of a single one."""
  values = np.asarray(values, np.float64)
  half = None
  if len(values) > 1:
    half = float(student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values)))
  return dict(mean=float(values.mean()), interval=half, values=values.tolist())


def judged(claim, rows) -> dict:
  """A claim's verdict; rows: {row: {seed: {metric: number}}} of its paper.

  What counts is the difference of the two rows in each seed, which share tokenizer, batches, captions and noise: the
  claim shows where its 95 % interval lies on the claimed side of 0, the opposite shows where it lies on the other.
  """
  a, b = ({seed: found[claim.metric] for seed, found in rows.get(row, {}).items() if claim.metric in found}
          for row in (claim.a, claim.b))
  seeds = sorted(a.keys() & b.keys())
  if not seeds:
    return dict(verdict=NOT_RUN, difference=None)
  difference = over_seeds([a[seed] - b[seed] for seed in seeds])
  if difference["interval"] is None:
    return dict(verdict=ONE_SEED, difference=difference)
  toward = difference["mean"] * (1 if claim.way == "higher" else -1)
  if abs(toward) <= difference["interval"]:
    return dict(verdict=DOES_NOT, difference=difference)
  return dict(verdict=SHOWS if toward > 0 else OPPOSITE, difference=difference)


def in_print(claim) -> dict:
  """The two numbers that a claim is about, as the paper prints them: {"a": .., "b": ..}."""
  printed = {row: name for name, row in TABLES[claim.source].items()}
  return {side: tables.paper_row(*claim.source, printed[row])[claim.metric]
          for side, row in (("a", claim.a), ("b", claim.b))}


def summarize(settings, found, real) -> dict:
  """All that a study found, as plain values.

  settings: a dict; found: the contents of scores.json files; real: {task: scores of real motions}. Of folders only the
  names are kept: their contents are identified by hash, and their paths are private.
  """
  settings = settings | dict(archives=[pathlib.Path(folder).name for folder in settings["archives"]],
                             teacher=pathlib.Path(settings["teacher"]).name)
  rows = {}  # {paper: {row: {seed: content}}}, in the order of the tables
  for one in sorted(found, key=lambda one: (names_of(one["paper"]).index(one["row"]), one["seed"])):
    rows.setdefault(one["paper"], {}).setdefault(one["row"], {})[one["seed"]] = one
  numbers = {paper: {row: {seed: _means(one) for seed, one in of.items()} for row, of in some.items()}
             for paper, some in rows.items()}
  table = {paper: {row: _row(of.values()) for row, of in some.items()} for paper, some in numbers.items()}
  claims = [claim._asdict() | {"paper": in_print(claim)} | judged(claim, numbers.get(claim.source[0], {}))
            for claim in CLAIMS if claim.source[0] in settings["papers"]]
  commits = collections.Counter(str((one.get("record") or {}).get("code")) for one in found)
  rows = {paper: {row: {seed: {key: value for key, value in one.items() if key != "record"} for seed, one in of.items()}
                  for row, of in some.items()} for paper, some in rows.items()}
  record = next((one["record"] for one in reversed(found) if one.get("record")), None)
  return dict(settings=settings, real=real, table=table, claims=claims, rows=rows, judged_by=dict(commits),
              record=record)


def _means(one):
  """{metric: mean over repeats} of what is finite."""
  return {metric: value["mean"] for metric, value in one["scores"].items()
          if value["mean"] is not None and math.isfinite(value["mean"])}


def _row(of_seeds):
  of_seeds = list(of_seeds)
  metrics = dict.fromkeys(metric for one in of_seeds for metric in one)
  return {metric: over_seeds([one[metric] for one in of_seeds if metric in one]) for metric in metrics}


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
      f"{settings['segments']} prompts a seed. Real motions: one number each."]
  parts += [line for note in study.get("notes", ()) for line in ("", f"**{note}**")]
  for source, names in TABLES.items():
    if any(row in study["table"].get(source[0], {}) for row in names.values()):
      parts += ["", *_table(study, source, names)]
  parts += ["", *_claims(study["claims"]), "", *_runs(study["rows"]), "", *_judged_by(study)]
  return "\n".join(parts) + "\n"


def _table(study, source, names):
  """Lines of a printed table: our rows, then the same rows of the paper."""
  paper, table = source
  ours, printed = study["table"][paper], tables.paper_table(*source)
  metrics = [metric for metric in printed.metrics if any(metric in ours.get(row, {}) for row in names.values())]
  real = {metric: value for of in study["real"].values() for metric, value in of.items()}
  head = ["row", *(f"ours: {tables.heading(m)}" for m in metrics), *(f"paper: {tables.heading(m)}" for m in metrics),
          "seeds"]
  body = [["real", *(_number(real.get(m) and {"mean": real[m]["mean"]}, m) for m in metrics), *[""] * len(metrics), ""]]
  for name, row in names.items():
    found, paper_row = ours.get(row, {}), printed.rows[name]
    seeds = max((len(value["values"]) for value in found.values()), default=0)
    body.append([f"{name} (`{row}`)", *(_number(found.get(m), m) for m in metrics),
                 *(_number(paper_row[m], m) for m in metrics), str(seeds)])
  return [f"## {paper.upper()}, rows of Table {table}", "", *_grid(head, body)]


def _number(value, metric):
  if not value or value.get("mean") is None:
    return "–"
  digits = value.get("digits", tables.METRICS[metric].digits if metric in tables.METRICS else 3)
  half = value.get("interval")
  return f"{value['mean']:.{digits}f}" + ("" if half is None else f" ± {half:.{digits}f}")


def _claims(claims):
  tried = [one for one in claims if one["verdict"] in (SHOWS, DOES_NOT, OPPOSITE)]
  count = {verdict: sum(one["verdict"] == verdict for one in tried) for verdict in (SHOWS, DOES_NOT, OPPOSITE)}
  body = []
  for one in claims:
    a, b = (f"{one['paper'][side]['mean']:.{one['paper'][side]['digits']}f}" for side in "ab")
    body.append([one["text"], f"{one['source'][0].upper()} {one['source'][1]}", tables.label(one["metric"]),
                 f"`{one['a']}` {one['way']} than `{one['b']}`", f"{a}, {b}",
                 _number(one["difference"], one["metric"]), one["verdict"]])
  return ["## The papers' claims", "",
          "Ours: the first row less the second, mean over seeds ± half of the 95 % interval of the differences; rows "
          "of a seed share all else. A claim that does not show at this scale is a finding, not a "
          f"failure. Of {len(tried)} claims {count[SHOWS]} show, {count[DOES_NOT]} do not, of {count[OPPOSITE]} the "
          "opposite shows; if nothing made a difference, one in forty would show, and as many the other way.", "",
          *_grid(["claim", "table", "metric", "rows", "paper", "ours", "verdict"], body)]


def _runs(rows):
  """Held-out numbers of what was trained, which tell whether a row was trained at all."""
  body, seen = [], set()
  for run in _all_runs(rows):
    if run["folder"] not in seen:
      seen.add(run["folder"])
      last = ", ".join(f"{name} {value:.4g}" for name, value in run["last"].items()
                       if name == "loss" or name.startswith("held_out"))
      body.append([f"`{run['folder']}`", str(run["steps"]), last, f"{run['seconds'] / 60:.1f}"])
  return ["## What was trained", "", *_grid(["run", "steps", "at the end", "minutes"], body)]


def _all_runs(rows):
  return [run for some in rows.values() for of in some.values() for one in of.values() for run in one["runs"]]


def _judged_by(study):
  """Which code the numbers are of; the record of the last row is in study.json."""
  lines = [f"- {count} rows by code {code}" for code, count in study["judged_by"].items()]
  if len(lines) > 1:
    lines.append("- **Not all by the same code: `study.py --again` evaluates again the rows of older code.**")
  return ["## What judged", "", *lines]


def _grid(head, body):
  return ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|", *("| " + " | ".join(row) + " |" for row in body)]
