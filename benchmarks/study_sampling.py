"""A registered study of what costs sampling alone: rows of one trained model, generation, edits and long motions.

  python benchmarks/study_sampling.py --registration docs/benchmark/registered/schedules.toml \
      --archives path/to/cmu path/to/bandai --out runs/schedules [--max_seconds N]
  ... --report          only writes study.json and study.md, of the pools and stories that all rows have

The same command continues where it stopped. A pool is 32 test clips, 32 edits or 4 stories; all rows sample a pool
before the next one begins, so that rows are compared on the same captions whenever it stops. A registration that has
changed since there are samples is refused unless --amend says why.
"""
import argparse
import json
import pathlib
import sys
import time

import jax
import numpy as np
import study
import study_plan
import study_registration
import study_report
import study_verdicts

from motion_jax import loading
from motion_jax.evaluation import aggregates, differences, provenance, samples
from motion_jax.evaluation.candidates import Candidate, check_options, hash_of
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.tasks.editing import editor
from motion_jax.evaluation.tasks.long_horizon import multi_prompt_generator, ways_of
from motion_jax.metrics import long_horizon, physics
from motion_jax.training import checkpoint

POOL = {"clips": 32, "edits": 32, "stories": 4}
TASKS = {"clips": "texts", "edits": "edits", "stories": "stories"}
CLIP_METRICS = ("top1", "top3", "fid", "matching", "clip_score", "skating", "jerk")
STORY_METRICS = ("transition_fid", "transition_kid", "peak_jerk", "auj")


class Sampling:
  """Rows of a model, their tasks, and the folder of their samples."""

  def __init__(self, registration, archives, out, bench=None):
    self.settings, self.out = registration.settings, pathlib.Path(out)
    self.model = loading.load(self.settings["model"])
    self.hash = hash_of(self.model)
    self.kinds = [kind for kind in POOL if self.settings.get(kind)]
    self.rows, self.edit_tasks = {}, {}
    for name, options in registration.rows.items():
      options = dict(options)
      self.edit_tasks[name] = options.pop("task", None)
      check_options(f"row {name}", self.model, (), options)
      self.rows[name] = Candidate(name, self.model, self.hash, self.out / "samples", None, options,
                                  tuple(jax.local_devices()), show=False)
    sizes = {name: self.settings[name] for name in ("stories", "segments") if name in self.settings}
    self.bench = bench or study.Bench(study_plan.Settings(tuple(archives), **sizes),
                                      more_readers=[next(iter(self.rows.values())).reader])

  def task(self, kind):
    return self.bench.task(TASKS[kind], self.settings["seed"])

  def pools(self):
    """[(kind, number)] in the order of sampling: first those without which there is no verdict, clips before stories,
    then a pool of clips and one of stories in turn."""
    counts = {kind: self.settings[kind] // POOL[kind] for kind in self.kinds}
    first = [(kind, i) for kind in counts for i in range(-(-self.settings["fewest"][kind] // POOL[kind]))]
    rest = [(kind, i) for i in range(max(counts.values())) for kind in counts if i < counts[kind]]
    return list(dict.fromkeys(first + rest))

  def store(self, row, kind):
    harness, candidate = self.task(kind).harness, self.rows[row]
    return samples.Store(candidate.folder, dict(
        kind=kind, model=self.hash, sampling=candidate.options, seed=harness.seed, items=harness.test_set.words_hash,
        segments=self.settings["segments"] if kind == "stories" else None,
        **({"task": self.edit_tasks[row], "data": harness.test_set.hash} if kind == "edits" else {})),
        provenance.maker(candidate.devices))

  def has(self, row, kind, pool):
    return self.store(row, kind).path(f"{row}_{kind}{pool:02d}", 0).is_file()

  def complete(self, kind):
    """How many pools, counted from the first, all rows have."""
    count = 0
    while count < self.settings.get(kind, 0) // POOL[kind] and all(self.has(row, kind, count) for row in self.rows):
      count += 1
    return count

  def jobs(self, row, kind):
    """(all jobs, make(jobs)) of a row, in the order of the draw."""
    task, candidate = self.task(kind), self.rows[row]
    if kind == "edits":
      drawn = task.harness.drawn(0)
      return (samples.jobs_of(task.test_set, drawn, task.harness.seed, 0), editor(
          candidate, task.protocol, drawn.cut(task.test_set.of(candidate.reader)), self.edit_tasks[row]))
    jobs = next(iter(task.requests(0, None))).jobs
    if kind == "clips":
      return jobs, candidate.generator()
    prompts, options = task.sequences(0), ways_of(candidate, task.protocol.way)
    timed = [list(zip(one.captions, (one.frames / self.model.stats.layout.fps).tolist())) for one in prompts]
    return (jobs._replace(frames=[int(sum(part)) for part in self.frames_of(row, prompts)]),
            multi_prompt_generator(candidate, timed, options))

  def frames_of(self, row, prompts):
    """The frames of each prompt as the row makes them."""
    way = ways_of(self.rows[row], self.task("stories").protocol.way)["way"]
    return [self.model.segment_frames(one.frames.tolist(), way) for one in prompts]

  def sample(self, row, kind, pool):
    """Motions [(rows, F)] of a pool, from its file or sampled."""
    jobs, make = self.jobs(row, kind)
    part = samples.Jobs(*(one[pool * POOL[kind]:(pool + 1) * POOL[kind]] for one in jobs))
    return samples.sample(make, self.store(row, kind), f"{row}_{kind}{pool:02d}", part, batch=POOL[kind])

  def run(self, seconds=None, kinds=tuple(POOL)):
    """Samples pool after pool of these kinds, until all are there or the time is over."""
    began = time.monotonic()
    for kind, pool in self.pools():
      for row in self.rows:
        if kind not in kinds or self.has(row, kind, pool):
          continue
        if seconds is not None and time.monotonic() - began > seconds:
          print("time is over; the same command continues", flush=True)
          return
        before, processor = time.monotonic(), time.process_time()
        motions = self.sample(row, kind, pool)
        print(f"{time.strftime('%H:%M:%S')} {row} {kind} {pool}: {len(motions)} motions, "
              f"{sum(map(len, motions))} frames, {time.monotonic() - before:.0f} s, "
              f"{time.process_time() - processor:.0f} s of processor time", flush=True)

  # --- numbers -----------------------------------------------------------------------------------------------------

  def clips(self, kind):
    """{row: `harness.Judged`} of the clips or edits that all rows have; {} where there are none."""
    pools = self.complete(kind)
    if not pools:
      return {}
    whole = self.task(kind).harness
    harness = Harness(whole.protocol, whole.evaluator, whole.clip_evaluator, whole.test_set, whole.seed,
                      pools * POOL[kind])
    return {row: harness.judged(0, [motion for pool in range(pools) for motion in self.sample(row, kind, pool)],
                                self.model.stats.layout) for row in self.rows}

  def stories(self):
    """{row: (numbers of all stories together, mean jerk across the transitions of each (S, W))} of the stories that
    all rows have."""
    pools, found = self.complete("stories"), {}
    if not pools:
      return {}
    task = self.task("stories")
    rules, skeleton = task._rules, task.harness.evaluator.layout.skeleton
    prompts = task.sequences(0)[:pools * POOL["stories"]]
    for row in self.rows:
      motions = [motion for pool in range(pools) for motion in self.sample(row, "stories", pool)]
      pieces = list(task._pieces(motions, prompts, self.frames_of(row, prompts), self.model.stats.layout))
      scored = long_horizon.score(pieces, task._reference(0), *task._scoring(0, rules))
      found[row] = scored.row, np.stack([jerk_across(one, rules, skeleton) for one in pieces])
    return found

  def summary(self, registration, kept):
    """All results as plain values."""
    clip_kind = "edits" if "edits" in self.kinds else "clips"
    clips, stories = self.clips(clip_kind), self.stories()
    draws, alpha, fewest = (registration.settings[name] for name in ("draws", "alpha", "fewest"))
    level = self.task("stories")._reference(0).level if stories else None
    auj = lambda curves: physics.area_under_jerk(curves.mean(0), level)
    effects = []
    for claim in registration.claims:
      found = clips if claim.metric in CLIP_METRICS else stories
      if not found:
        effects.append((claim, None, 0, 1))
        continue
      if found is clips:
        a, b = (clips[row].by_motion.values[claim.metric] for row in (claim.a, claim.b))
      else:
        a, b = (stories[row][1] for row in (claim.a, claim.b))
      statistic, kind = (np.mean, clip_kind) if found is clips else (auj, "stories")
      effects.append((claim, study_verdicts.over_clusters(a, b, statistic, draws, alpha), len(a), fewest[kind]))
    table = {clip_kind: {row: differences.over_clips([one.by_motion]) for row, one in clips.items()},
             "stories": {row: {metric: _over_stories(metric, *one, auj) for metric in STORY_METRICS}
                         for row, one in stories.items()}}
    return dict(registration=kept, rules=registration.settings["rules"].strip(), alpha=registration.settings["alpha"],
                title=registration.settings["title"], model=self.settings["model"], model_hash=self.hash,
                samples={kind: self.complete(kind) * POOL[kind] for kind in self.kinds},
                segments=self.settings.get("segments"),
                registered={kind: self.settings[kind] for kind in self.kinds}, rows=registration.rows, table=table,
                claims=study_report.judged(effects, registration.settings["alpha"]), made_by=self.makers())

  def makers(self):
    """Code and machines that sampled."""
    made = [maker for row in self.rows for kind in self.kinds if self.complete(kind)
            for maker in self.store(row, kind).makers]
    return [json.loads(one) for one in dict.fromkeys(json.dumps(maker, sort_keys=True) for maker in made)]


def jerk_across(story, rules, skeleton):
  """Mean jerk (W,) across the transitions of a `long_horizon.Sequence`, as its score has it of all."""
  borders = np.cumsum(long_horizon.whole_units(story.frames, rules))[:-1]
  cut = physics.cut_transitions(story.joints, borders, rules.width)
  moved = [long_horizon.placed(one, skeleton) for one in cut] if rules.placed else cut
  return rules.jerk_scale * physics.jerk(np.stack(moved)).mean(0)


def _over_stories(metric, numbers, curves, auj):
  """{"mean", "interval"} of a metric of all stories; interval: half of the 95 % one over stories, of AUJ alone."""
  if metric != "auj" or len(curves) < 2:
    return dict(mean=numbers[metric], interval=None)
  rng = np.random.default_rng(0)
  drawn = [auj(curves[rng.integers(len(curves), size=len(curves))]) for _ in range(1000)]
  return dict(mean=numbers[metric], interval=float(1.96 * np.std(drawn)))


def markdown(study) -> str:
  """study.md."""
  counts, registered = study["samples"], study["registered"]
  lines = [f"# {study['title']}", "", *study_registration.lines(study["registration"]), "", study["rules"], "",
           "Sampled with every row: **" + ", ".join(
               f"{counts[kind]} of {registered[kind]} {kind}"
               + (f" of {study['segments']} prompts" if kind == "stories" else "") for kind in counts)
           + "**; one seed. Numbers are of our own benchmark and compare with nothing on HumanML3D."]
  for kind, metrics in (("clips", CLIP_METRICS), ("edits", CLIP_METRICS), ("stories", STORY_METRICS)):
    if study["table"].get(kind):
      lines += ["", f"## {kind.capitalize()}", "", f"± is half of a 95 % interval, by a bootstrap over {kind}.", "",
                *study_report.grid(["row", *map(study_report.label, metrics)], [
                    [f"`{row}`", *(study_report.number(of.get(metric), metric) for metric in metrics)]
                    for row, of in study["table"][kind].items()])]
  lines += ["", *study_report.claims_section(study["claims"], study["alpha"]), "", "## What sampled", "",
            *(f"- code {one.get('code')}, jax {one.get('jax')}, {one.get('device')}" for one in study["made_by"])]
  return "\n".join(lines) + "\n"


def parse(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  add = parser.add_argument
  add("--registration", required=True, help="such as docs/benchmark/registered/schedules.toml")
  add("--archives", nargs="+", required=True, help="folders of motion_jax.data.datasets.archive")
  add("--out", required=True, help="folder of the study; an existing one is continued")
  add("--kinds", nargs="+", choices=POOL, default=[*POOL], help="sample these now (default: all)")
  add("--max_seconds", type=float, help="begin nothing after so long")
  add("--amend", metavar="WHY", help="take a registration that has changed since there are results")
  add("--report", action="store_true", help="sample nothing, write the report of what is there")
  return parser.parse_args(argv)


def main(argv=None):
  args = parse(argv)
  try:
    registration = study_registration.load(args.registration)
    out = pathlib.Path(args.out)
    kept = study_registration.keep(registration, out, any((out / "samples").glob("*/*.npz")), args.amend)
    jax.config.update("jax_compilation_cache_dir", str((out / "compiled").absolute()))
    sampling = Sampling(registration, args.archives, out)
    if not args.report:
      sampling.run(args.max_seconds, args.kinds)
    study = aggregates.json_ready(sampling.summary(registration, kept))
    checkpoint.save_text(out, "study.json", json.dumps(study, indent=1, allow_nan=False) + "\n")
    checkpoint.save_text(out, "study.md", markdown(study))
  except (ValueError, FileNotFoundError) as error:
    sys.exit(f"study_sampling.py: {error}")
  print(f"wrote {out}/study.md, study.json")


if __name__ == "__main__":
  main()
