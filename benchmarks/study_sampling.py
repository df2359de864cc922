"""A registered study of what costs sampling alone: rows of one trained model, generation and long motions.

  python benchmarks/study_sampling.py --registration docs/benchmark/registered/schedules.toml \
      --archives path/to/cmu path/to/bandai --out runs/schedules [--max_seconds N]
  ... --report          only writes study.json and study.md, of the pools and stories that all rows have

The same command continues where it stopped. A pool is 32 test clips or 4 stories; all rows sample a pool before the next
one begins, clips before stories, so that rows are compared on the same captions whenever it stops. A registration that
has changed since there are samples is refused unless --amend says why.
"""
import argparse
import pathlib
import sys
import time

import jax
import numpy as np
import study
import study_plan
import study_registration

from motion_jax import loading
from motion_jax.evaluation import provenance, samples
from motion_jax.evaluation.candidates import Candidate, check_options, hash_of
from motion_jax.evaluation.tasks.long_horizon import multi_prompt_generator, ways_of

POOL = {"clips": 32, "stories": 4}
TASKS = {"clips": "texts", "stories": "stories"}


class Sampling:
  """Rows of a model, their tasks, and the folder of their samples."""

  def __init__(self, registration, archives, out, bench=None):
    self.settings, self.out = registration.settings, pathlib.Path(out)
    self.model = loading.load(self.settings["model"])
    self.hash = hash_of(self.model)
    for name, options in registration.rows.items():
      check_options(f"row {name}", self.model, (), options)
    self.rows = {name: Candidate(name, self.model, self.hash, self.out / "samples", None, dict(options),
                                 tuple(jax.local_devices()), show=False)
                 for name, options in registration.rows.items()}
    self.bench = bench or study.Bench(study_plan.Settings(
        tuple(archives), stories=self.settings["stories"], segments=self.settings["segments"]))

  def task(self, kind):
    return self.bench.task(TASKS[kind], self.settings["seed"])

  def pools(self):
    """[(kind, number)] in the order of sampling: as many pools of clips as of stories, and what is left."""
    counts = {kind: self.settings[kind] // POOL[kind] for kind in POOL}
    return [(kind, i) for i in range(max(counts.values())) for kind in POOL if i < counts[kind]]

  def store(self, row, kind):
    harness, candidate = self.task(kind).harness, self.rows[row]
    return samples.Store(candidate.folder, dict(
        kind=kind, model=self.hash, sampling=candidate.options, seed=harness.seed, items=harness.test_set.words_hash,
        segments=self.settings["segments"] if kind == "stories" else None), provenance.maker(candidate.devices))

  def jobs(self, row, kind):
    """(all jobs, make(jobs)) of a row, in the order of the draw."""
    task, candidate = self.task(kind), self.rows[row]
    if kind == "clips":
      return next(iter(task.wanted(0, None))).jobs, candidate.generator()
    prompts, options = task.sequences(0), ways_of(candidate, task.protocol.way)
    counts = [self.model.segment_frames(one.frames.tolist(), options["way"]) for one in prompts]
    timed = [list(zip(one.captions, (one.frames / self.model.stats.layout.fps).tolist())) for one in prompts]
    jobs = task.wanted(0, None)
    jobs = next(iter(jobs)).jobs._replace(frames=[int(sum(part)) for part in counts])
    return jobs, multi_prompt_generator(candidate, timed, options)

  def sample(self, row, kind, pool, only_read=False):
    """Motions [(rows, F)] of a pool, from its file or sampled; None where there is none and only_read."""
    jobs, make = self.jobs(row, kind)
    part = samples.Jobs(*(one[pool * POOL[kind]:(pool + 1) * POOL[kind]] for one in jobs))
    store, name = self.store(row, kind), f"{row}_{kind}{pool:02d}"
    if only_read and not store.path(name, 0).is_file():
      return None
    return samples.sample(make, store, name, part, batch=POOL[kind])

  def run(self, seconds=None):
    """Samples pool after pool; returns whether all are there."""
    began = time.monotonic()
    for kind, pool in self.pools():
      for row in self.rows:
        if self.sample_if_missing(row, kind, pool, began, seconds) is None:
          print("time is over; the same command continues", flush=True)
          return False
    return True

  def sample_if_missing(self, row, kind, pool, began, seconds):
    if self.store(row, kind).path(f"{row}_{kind}{pool:02d}", 0).is_file():
      return True
    if seconds is not None and time.monotonic() - began > seconds:
      return None
    before, cpu = time.monotonic(), time.process_time()
    motions = self.sample(row, kind, pool)
    frames = sum(map(len, motions))
    print(f"{time.strftime('%H:%M:%S')} {row} {kind} {pool}: {len(motions)} motions, {frames} frames, "
          f"{time.monotonic() - before:.0f} s, {time.process_time() - cpu:.0f} s of processor time", flush=True)
    return True

  @property
  def has_results(self):
    return any((self.out / "samples").glob("*/*.npz"))


def parse(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  add = parser.add_argument
  add("--registration", required=True, help="such as docs/benchmark/registered/schedules.toml")
  add("--archives", nargs="+", required=True, help="folders of motion_jax.data.datasets.archive")
  add("--out", required=True, help="folder of the study; an existing one is continued")
  add("--max_seconds", type=float, help="begin nothing after so long")
  add("--amend", metavar="WHY", help="take a registration that has changed since there are results")
  add("--report", action="store_true", help="sample nothing, write the report of what is there")
  return parser.parse_args(argv)


def main(argv=None):
  args = parse(argv)
  try:
    registration = study_registration.load(args.registration)
    out = pathlib.Path(args.out)
    study_registration.keep(registration, out, any((out / "samples").glob("*/*.npz")), args.amend)
    jax.config.update("jax_compilation_cache_dir", str((out / "compiled").absolute()))
    sampling = Sampling(registration, args.archives, out)
    if not args.report:
      sampling.run(args.max_seconds)
  except (ValueError, FileNotFoundError) as error:
    sys.exit(f"study_sampling.py: {error}")


if __name__ == "__main__":
  main()
