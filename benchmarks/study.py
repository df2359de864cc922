"""The papers' ablations at small scale: every row trained alike, evaluated by our own benchmark, claims with verdicts.

  python benchmarks/study.py --archives path/to/cmu path/to/bandai --out runs/study [--papers cmdm cdamd]
      [--registration docs/benchmark/registered/mini.toml] [--only ROW ...] [--max_seconds N]
  ... --part 0/2 in one shell, --part 1/2 in another: two processes share the work
  ... --again                                         evaluates again the rows that other code evaluated
  ... --amend "why"                                   takes a registration that has changed since there are results
  ... --report                                        only writes study.json and study.md

What is claimed, which metric decides, how many seeds and steps: the registration says it, before there are results
(benchmarks/study_registration.py). Flags that differ from it are listed in the report.

Rows: CMDM's Table 4 with its sampling rows, CDAMD's Tables I, IV, V and MARDM, by the configs of configs/ablations/.
The same command continues where it stopped; finished parts are not repeated. The folder holds PAPER/seedN/ROW/ with a
run folder for each stage and scores.json with its provenance; study.json and study.md are written after every row.
Other data, another teacher or other evaluators than those of the folder's rows are refused.

Tokenizers and RVQ-VAEs are trained once per seed, and the rows of a seed share them. Once for all seeds would save some
of the time, but then the chance of each tokenizer would be in all seeds alike, and the intervals would not cover it:
half of CMDM's claims are about tokenizers. Draws from the test clips are different for each seed for the same reason.
The teacher is the shipped one.

Evaluated are the averaged weights, without cleanup: texts of the test clips by `archives-66`, without multimodality;
for CMDM also long motions by the long-horizon protocol, shorter ones, with AUJ relative to the jerk of the archives'
clips. The row of one level for all is sampled as it was trained, all frames at once. These numbers are our own
benchmark's and do not compare with HumanML3D's.
"""
import argparse
import contextlib
import dataclasses
import hashlib
import json
import pathlib
import shutil
import sys
import time

import jax
import study_plan
import study_registration
import study_report
from absl import logging

from motion_jax import fit as training
from motion_jax import loading
from motion_jax.data import sources
from motion_jax.evaluation import aggregates, protocols, provenance
from motion_jax.evaluation.candidates import Candidate, hash_of
from motion_jax.evaluation.checks import sanity
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.tasks.base import Task
from motion_jax.evaluation.tasks.editing import Editing
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.evaluation.tasks.long_horizon import LongHorizon
from motion_jax.evaluation.test_set import read_test_set
from motion_jax.evaluators.evaluator import load_evaluator, shipped_names
from motion_jax.models.cmdm.setup import not_sampled
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics

TRAINED, SETTINGS, REAL, TIME = "trained.json", "settings.json", "real.json", "time.json"
STORY_METRICS = ("transition_fid", "transition_diversity", "transition_distance", "peak_jerk", "auj")


class Clock:
  """Time that is left of a slice; without a limit there is always some."""

  def __init__(self, seconds=None):
    self.end = None if seconds is None else time.monotonic() + seconds

  @property
  def left(self):
    return None if self.end is None else self.end - time.monotonic()

  def check(self):
    if self.end is not None and self.left <= 0:
      raise Stopped


class Stopped(Exception):
  """The time is over, or a signal came; everything is saved."""


# --- judging -----------------------------------------------------------------------------------------------------


class Bench:
  """The test clips and evaluators, read once for all rows."""

  def __init__(self, settings, force=False, more_readers=()):
    """more_readers: further representations in which edits are given their real clips."""
    self.settings, self.force, self.more_readers, self.read, self.tasks = settings, force, more_readers, {}, {}

  def task(self, name, seed) -> Task:
    """Of "texts", "edits" or "stories"; raises ValueError where the evaluators do not look right on real clips.

    Each seed of the study has captions, cuts, noise and stories of its own, the same for all rows: intervals over
    seeds know of that luck as well, and rows of a seed are still pairs.
    """
    if (name, seed) not in self.tasks:
      protocol, readers, found = self._read(name)
      limit = self.settings.samples if name == "texts" else None
      harness = Harness(protocol, *readers, found, protocol.seed + seed, limit)
      if name == "texts":
        sanity.require(sanity.check(harness), self.force)
      self.tasks = {key: one for key, one in self.tasks.items() if key[1] == seed} | {
          (name, seed): _TASKS[name](harness)}
    return self.tasks[name, seed]

  def _read(self, name):
    if name not in self.read:
      protocol = self._protocol(name).on("archive")
      readers = [load_evaluator(self.settings.evaluator), self._clip() if name != "stories" else None]
      more = self.more_readers if name == "edits" else ()
      test_set = read_test_set(self.settings.archives, protocol, [*(one for one in readers if one), *more])
      self.read[name] = protocol, readers, test_set
    return self.read[name]

  def _protocol(self, name):
    if name == "texts":
      return protocols.get_protocol("archives-66").without_multimodality()
    if name == "edits":
      return protocols.get_protocol("editing")
    return dataclasses.replace(protocols.get_protocol("long-horizon"), sequences=self.settings.stories,
                               segments=self.settings.segments, real_jerk=None, way="stream")

  def _clip(self):
    name = self.settings.clip_evaluator
    known = pathlib.Path(name).is_dir() or name in shipped_names()
    if not known and name != "none":
      print(f"no evaluator {name!r}: rows have no CLIP score")
    return load_evaluator(name) if known else None

  def real(self):
    """{"texts", "stories": {metric: number}} of the real clips, in the places of the first seed's first repeat."""
    return {name: _numbers([self.task(name, 0).real(0).rows["real"]], name) for name in ("texts", "stories")}

  def scores(self, row, folder, clock):
    """{metric: {"mean", "interval", "values"}} over repeats of a row, and the provenance of its texts."""
    loaded = loading.load(folder)
    candidate = Candidate(row.name, loaded, hash_of(loaded), folder / "eval" / "samples", None, row.sampling,
                          tuple(jax.local_devices()), show=False)
    found = {}
    for name in ("texts", "stories") if row.paper == "cmdm" else ("texts",):
      repeats = []
      for replication in range(self.settings.repeats):
        clock.check()
        repeats.append(self.task(name, row.seed).score(candidate, replication).rows[""])
      found |= _numbers(repeats, name)
    return found, provenance.describe(self.task("texts", row.seed).harness, self.settings.archives, [candidate],
                                      self.settings.repeats, candidate.devices)


_TASKS = {"texts": Generation, "edits": Editing, "stories": LongHorizon}


def _numbers(repeats, name):
  metrics = STORY_METRICS if name == "stories" else list(repeats[0])
  return {metric: aggregates.interval([one[metric] for one in repeats]) for metric in metrics}


# --- training ----------------------------------------------------------------------------------------------------


def train_run(one, settings, out, parts, clock, failed):
  """Trains a run to its last step, from where it is. Raises Stopped where time does not suffice.

  failed: runs that could not be trained, which no other row of this process tries again.
  """
  folder = out / one.folder
  if (folder / TRAINED).is_file():
    return
  if one in failed:
    raise FloatingPointError(f"{one.folder} could not be trained")
  clock.check()
  print(f"  {one.folder}: {settings.steps[one.stage]} steps", flush=True)
  folder.mkdir(parents=True, exist_ok=True)
  config, begin = study_plan.config_of(one, settings, out, parts), time.monotonic()
  for note in not_sampled(config) if one.stage == "denoiser" else ():
    print(f"  note: {note}", flush=True)
  before = checkpoint.load_json(folder, TIME)["seconds"] if (folder / TIME).is_file() else 0.0
  try:
    with open(folder / "log.txt", "a", encoding="utf-8") as log, contextlib.redirect_stdout(log):
      state = training.run(config, folder, resume=True, max_seconds=clock.left)
  except FloatingPointError:
    failed.add(one)
    raise
  seconds = round(before + time.monotonic() - begin, 1)
  write_json(folder, TIME, dict(seconds=seconds))
  if int(state.step) < config.train.num_steps:
    raise Stopped
  last = {name: value for line in read_metrics(folder) for name, value in line.items()}
  write_json(folder, TRAINED, dict(folder=one.folder, steps=int(state.step), seconds=seconds, last=last))
  shutil.rmtree(folder / "checkpoints")  # three times the parameters, and of no more use
  print(f"  {one.folder}: {time.monotonic() - begin:.0f} s, loss {last['loss']:.4g}", flush=True)


def do_row(row, settings, out, bench, clock, failed):
  """Trains and judges a row, and writes its scores."""
  parts = {}
  for one in row.runs:
    train_run(one, settings, out, parts, clock, failed)
    parts[one.stage] = one.folder
  begin = time.monotonic()
  scores, record = bench.scores(row, out / row.runs[-1].folder, clock)
  runs = [checkpoint.load_json(out / one.folder, TRAINED) for one in row.runs]
  path = out / row.scores
  path.parent.mkdir(parents=True, exist_ok=True)
  write_json(path.parent, path.name, dict(
      paper=row.paper, row=row.name, seed=row.seed, scores=scores, runs=runs,
      seconds=round(time.monotonic() - begin, 1), record=record))
  tell = {name: scores[name]["mean"] for name in ("top1", "fid", "auj") if name in scores}
  print(f"  judged in {time.monotonic() - begin:.0f} s: " + ", ".join(f"{k} {v:.3f}" for k, v in tell.items()),
        flush=True)


def write_json(folder, name, content):
  checkpoint.save_text(folder, name, json.dumps(aggregates.json_ready(content), indent=1, allow_nan=False) + "\n")


# --- a study -----------------------------------------------------------------------------------------------------


def run_study(settings, out, registration, part=(0, 1), only=(), max_seconds=None, force=False, again=False):
  """Does the rows of a part, and writes study.json and study.md after each. Returns whether all of them are done.

  again: rows that another commit evaluated are evaluated again; their motions are kept.
  """
  rows = study_plan.plan(settings, part, only)
  out, clock = pathlib.Path(out), Clock(max_seconds)
  out.mkdir(parents=True, exist_ok=True)
  keep_settings(settings, out)
  bench, whole, failed = Bench(settings, force), True, set()
  with sources.keep_features():
    for number, row in enumerate(rows, 1):
      name = f"[{number}/{len(rows)}] {row.paper} {row.name}, seed {row.seed}"
      if (out / row.scores).is_file() and not (again and judged_by(out, row) != provenance.commit()):
        print(f"{name}: done before", flush=True)
        continue
      print(name, flush=True)
      try:
        if not (out / REAL).is_file() or again:
          clock.check()
          write_json(out, REAL, bench.real())
        do_row(row, settings, out, bench, clock, failed)
      except Stopped:
        print("stopped and saved; the same command continues", flush=True)
        return False
      except FloatingPointError as error:  # reported, and tried again the next time
        print(f"  {error}", flush=True)
        whole = False
      write_report(out, registration)
      jax.clear_caches()  # every row compiles functions of its own; a process that kept them all would run out of maps
  write_report(out, registration)
  return whole


def judged_by(out, row):
  """The commit that judged a row."""
  path = out / row.scores
  return checkpoint.load_json(path.parent, path.name).get("record", {}).get("code")


def keep_settings(settings, out):
  """Writes the study's settings, with hashes of what they name, or raises ValueError where the folder holds a study by
  others. Papers and seeds may be added, folders may have moved.
  """
  wanted = json.loads(json.dumps(dataclasses.asdict(settings) | {"hashes": hashes_of(settings)}))
  if (out / SETTINGS).is_file():
    before = checkpoint.load_json(out, SETTINGS)
    before.setdefault("hashes", wanted["hashes"])
    other = [name for name in wanted if name not in ("papers", "seeds", "archives", "teacher")
             and wanted[name] != before.get(name)]
    if other:
      raise ValueError(f"{out} holds a study with " + ", ".join(f"{n} {before.get(n)!r}" for n in other)
                       + ", requested " + ", ".join(f"{wanted[n]!r}" for n in other) + "; rows of one study are alike: "
                       "take another --out")
    wanted |= dict(papers=[p for p in study_plan.PAPERS if p in wanted["papers"] or p in before["papers"]],
                  seeds=max(wanted["seeds"], before["seeds"]))
  write_json(out, SETTINGS, wanted)


def hashes_of(settings) -> dict:
  """The beginnings of sha256 sums of the archives, in their order, the teacher and the evaluators."""
  folders = {f"archive {i}": (folder, ("motions.npz", "captions.jsonl")) for i, folder in enumerate(settings.archives)}
  folders["teacher"] = settings.teacher, (checkpoint.PARAMS, "Mean.npy", "Std.npy")
  found = {}
  for name, (folder, files) in folders.items():
    digest = hashlib.sha256()
    for path in (pathlib.Path(folder) / file for file in files):
      digest.update(path.read_bytes() if path.is_file() else b"")
    found[name] = digest.hexdigest()[:16]
  for name in (settings.evaluator, settings.clip_evaluator):
    if pathlib.Path(name).is_dir() or name in shipped_names():
      found[name] = load_evaluator(name).hash[:16]
  return found


def results_in(out):
  """The files of scores of a study's folder."""
  return sorted(pathlib.Path(out).glob("*/seed*/*/scores.json"))


def write_report(out, registration):
  """study.json and study.md from the rows that are done, by whichever process."""
  found = [checkpoint.load_json(path.parent, path.name) for path in results_in(out)]
  real = checkpoint.load_json(out, REAL) if (out / REAL).is_file() else {}
  settings = checkpoint.load_json(out, SETTINGS)
  study = study_report.summarize(settings, found, real, registration,
                                 checkpoint.load_json(out, study_registration.FILE))
  study["notes"] = [f"Not as registered: {name} is {settings[name]}, registered is {value}."
                    for name, value in registration.settings.get("study", {}).items() if settings[name] != value]
  write_json(out, "study.json", study)
  checkpoint.save_text(out, "study.md", study_report.markdown(study))


def parse(argv=None):
  """(registration, Settings, arguments, part); defaults are those of the registration."""
  first = argparse.ArgumentParser(add_help=False)
  first.add_argument("--registration", default=str(study_plan.ROOT / "docs/benchmark/registered/mini.toml"),
                     help="claims, seeds and steps of the study (%(default)s)")
  known, _ = first.parse_known_args(argv)
  registration = study_registration.load(known.registration)
  registered = dict(registration.settings.get("study", {}))
  defaults = dataclasses.replace(study_plan.Settings(()), **registered)
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], parents=[first])
  add = parser.add_argument
  add("--archives", nargs="+", required=True, help="folders of motion_jax.data.datasets.archive")
  add("--out", required=True, help="folder of the study; an existing one is continued")
  add("--papers", nargs="+", default=defaults.papers, choices=study_plan.PAPERS)
  add("--seeds", type=int, default=defaults.seeds)
  add("--steps", nargs="+", default=[], metavar="STAGE=N", help=f"by default {defaults.steps}")
  add("--size", default=defaults.size, choices=("small", "mini", "tiny"), help="of the models")
  add("--repeats", type=int, default=defaults.repeats, help="passes over the test clips for a row")
  add("--samples", type=int, default=defaults.samples, help="fewer test clips, for a trial")
  add("--stories", type=int, default=defaults.stories)
  add("--segments", type=int, default=defaults.segments, help="prompts of a story")
  add("--teacher", default=defaults.teacher, help="folder of a teacher that was trained on these archives")
  add("--evaluator", default=defaults.evaluator)
  add("--clip_evaluator", default=defaults.clip_evaluator, help="or none")
  add("--only", nargs="+", default=[], metavar="ROW")
  add("--part", default="0/1", help="such as 0/2 and 1/2, with the same arguments otherwise")
  add("--max_seconds", type=float, help="stop and save after so long")
  add("--again", action="store_true", help="evaluate again the rows that another commit evaluated, from their motions")
  add("--force", action="store_true", help="go on though evaluators do not look right on the real clips")
  add("--report", action="store_true", help="train and judge nothing, write the report of what is there")
  add("--amend", metavar="WHY",
      help="take a registration that has changed since there are results; the report prints why")
  args = parser.parse_args(argv)
  steps = dict(defaults.steps)
  for text in args.steps:
    stage, _, count = text.partition("=")
    if stage not in steps or not count.isdigit() or not int(count):
      raise ValueError(f"got --steps {text}, expected STAGE=N with a stage of {', '.join(steps)}")
    steps[stage] = int(count)
  index, slash, count = args.part.partition("/")
  if not (index.isdigit() and slash and count.isdigit()):
    raise ValueError(f"got --part {args.part}, expected one such as 0/2")
  fields = {field.name: getattr(args, field.name) for field in dataclasses.fields(defaults) if field.name != "steps"}
  fields |= dict(steps=steps, archives=tuple(args.archives), papers=tuple(args.papers))
  return registration, study_plan.Settings(**fields), args, (int(index), int(count))


def main():
  logging.set_verbosity(logging.WARNING)  # orbax tells every step of a save
  try:
    registration, settings, args, part = parse()
    out = pathlib.Path(args.out)
    study_registration.keep(registration, out, bool(results_in(out)), args.amend)
    if args.report:
      write_report(out, registration)
    else:
      # Seeds and rows compile the same functions again.
      jax.config.update("jax_compilation_cache_dir", str((out / "compiled").absolute()))
      done = run_study(settings, out, registration, part, args.only, args.max_seconds, args.force, args.again)
      print("all rows of this part are done" if done else "some rows are missing; run the same command again")
  except (ValueError, FileNotFoundError) as error:
    sys.exit(f"study.py: {error}")
  print(f"wrote {out}/study.md, study.json")


if __name__ == "__main__":
  main()
