"""From runs, data and a protocol to a result: rows of real and made motions with intervals, and their provenance."""
import contextlib
import dataclasses
import json
import pathlib
import time
from collections.abc import Iterator
from functools import partial

import jax

from motion_jax.evaluation import aggregates, external, provenance
from motion_jax.evaluation.candidates import Choices, Reader, load_candidates
from motion_jax.evaluation.checks import controls as controls_lib
from motion_jax.evaluation.checks import sanity as sanity_lib
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.report import differences as difference_tables
from motion_jax.evaluation.report import gallery, printed, tables
from motion_jax.evaluation.request import Request, default_out, load_evaluators, resolve
from motion_jax.evaluation.result import FILE, Result
from motion_jax.evaluation.tasks.registry import TASKS
from motion_jax.evaluation.test_set import TestSet, read_test_set
from motion_jax.motion.representations import get_layout
from motion_jax.utils.atomic import atomic_path

TABLES = {"tables.md": difference_tables.whole(tables.markdown), "tables.tex": difference_tables.whole(tables.latex),
          "tables.csv": tables.csv}


def evaluate(runs, folders, protocol=None, *, evaluator=None, clip_evaluator=None, out=None, replications=None,
             seed=None, guidance=(), sampling=None, vary=(), limit=None, controls=False, multimodality=True,
             force=False, only_read=False, raw=False, devices=None, show=True, samples=None, motions=(),
             allow_shared=False) -> Result:
  """Judges runs (folders, or names that ship) on data folders by a protocol, and writes results.json in `out`.

  evaluator, clip_evaluator: names, folders or `Evaluator`s, the protocol's by default; clip_evaluator "none": no CLIP
  score. guidance: scales, a row each; the models' own by default. sampling: what else `generate` takes; vary: changes
  of it, a row each for the models that know them. limit: samples of a trial; of long motions, sequences or timelines.
  controls: damaged real motions, too. force: go on though real data does not look right. only_read: from samples that
  exist (reconstructions are none, they are always made). raw: the last weights of a run, not their average. devices: of
  jax; they change nothing but the time. samples: folder where motions are kept, for several evaluations to share; by
  default the run's, or of a model that ships `out`. motions: (name, folder) of what other programs made, see
  `evaluation.external`. allow_shared: judge clips that train has, too, and name them in the provenance.
  """
  clock, devices = Clock(show), tuple(devices or jax.local_devices())
  asked = resolve(runs, folders, protocol, limit, multimodality)
  task_class = TASKS[asked.protocol.task]
  folder = pathlib.Path(out) if out else default_out(runs, asked.protocol)
  main, clip = load_evaluators(asked.protocol, evaluator, clip_evaluator)
  varied = tuple(vary) or ({},)
  choices = Choices(tuple(guidance), sampling or {}, varied, task_class.OPTIONS)
  load = partial(task_class.load, raw=True) if raw else task_class.load
  candidates, left_out = load_candidates(runs, load, choices, folder, samples, devices, only_read, show)
  others = [external.load_external(name, place, main, task_class.TEXT_TO_MOTION) for name, place in motions]

  with clock.part("data"):
    readers = [] if task_class.TEXT_TO_MOTION else [one.reader for one in [*candidates, *others]]
    test_set = read_for(asked, main, clip, readers, allow_shared)
    clock.say(_about(test_set, asked.protocol))
  harness = _harness(asked, main, clip, test_set, seed)
  protocol, task, candidates = harness.protocol, task_class(harness), [*candidates, *others]
  if not out:
    _check_out(folder, provenance.question(harness, candidates))

  replications = range(protocol.replications if replications is None else replications)
  with clock.part("real data"):
    sanity = sanity_lib.look(harness)
    sanity_lib.demand(sanity, force)
    for warning in sanity["warnings"]:
      clock.say(f"mind: {warning}")
    rows, curves = aggregates.collect(map(task.real, replications), protocol.population_std)
  made, by_motion = {}, {}
  for candidate in candidates:
    with clock.part(candidate.name):
      found = [task.found(candidate, replication) for replication in replications]
      own, drawn = aggregates.collect(found, protocol.population_std)
    by_motion |= {aggregates.row_name(candidate.name, part): [one.by_motion[part] for one in found]
                  for part in found[0].by_motion}
    made |= {aggregates.row_name(candidate.name, part): (candidate, part) for part in own}
    rows |= {aggregates.row_name(candidate.name, part): row for part, row in own.items()}
    curves |= {aggregates.row_name(candidate.name, part): curve for part, curve in drawn.items()}
  with clock.part("differences"):
    compared = aggregates.compared(made, by_motion, harness.seed)
    uncertain = aggregates.uncertain(harness, made, by_motion, compared)
  checked = None
  if controls:
    with clock.part("controls"):
      checked = controls_lib.check(task, spread=aggregates.spread(rows["real"]))

  result = Result(**aggregates.json_ready(dict(
      protocol=protocol.name, title=protocol.title, rows=rows, row_order=["real", *made],
      metrics=[name for name in task.METRICS if any(name in row for row in rows.values())],
      paper=printed.paper_of(protocol, main, made, asked.whole),
      notes=[note for note in (protocol.note, *uncertain, *task.notes, *left_out) if note],
      provenance=provenance.describe(harness, asked.folders, candidates, len(replications), devices),
      sanity=sanity, controls=checked, differences=compared,
      curves=aggregates.guidance_curves(rows, candidates) | (controls_lib.curves(checked) if checked else {})
      | aggregates.transition_curves(curves, protocol.population_std))))
  if candidates and task.TEXT_TO_MOTION:
    with clock.part("gallery"):
      result = dataclasses.replace(result, gallery=gallery.write(task, candidates[0], folder))
  return write(result, folder, clock.seconds)


def ask(folders, out, protocol=None, *, evaluator=None, replications=None, seed=None, limit=None, multimodality=True,
        allow_shared=False) -> pathlib.Path:
  """Writes what a protocol wants another program to make, with the real motions that it is made of; see
  `evaluation.external`."""
  asked = resolve((), folders, protocol, limit, multimodality)
  main, _ = load_evaluators(asked.protocol, evaluator, "none")
  reader = external.joint_reader(main)
  task = TASKS[asked.protocol.task]
  readers = [] if task.TEXT_TO_MOTION else [reader]
  harness = _harness(asked, main, None, read_for(asked, main, readers=readers, allow_shared=allow_shared), seed)
  return external.ask(task(harness), reader, out,
                      harness.protocol.replications if replications is None else replications)


def write(result, out, seconds=None) -> Result:
  """results.json and tables in a folder, and timings.json, which is no part of a result; returns the result that knows
  where it lies."""
  for name, text in {name: form(result) for name, form in TABLES.items()}.items():
    _write(pathlib.Path(out) / name, text)
  _write(pathlib.Path(out) / "timings.json", json.dumps(seconds or {}, indent=1) + "\n")
  return result.write(out)


def _write(path, text):
  with atomic_path(path) as place:
    place.write_text(text, encoding="utf-8")


class Clock:
  """Says what is done, and where the time went."""

  def __init__(self, show):
    self.show, self.seconds = show, {}

  @contextlib.contextmanager
  def part(self, name) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    self.seconds[name] = round(time.perf_counter() - begin, 2)
    self.say(f"{name}: {self.seconds[name]:.1f} s")

  def say(self, text):
    if self.show:
      print(text, flush=True)


def read_for(asked: Request, main, clip=None, readers=(), allow_shared=False) -> TestSet:
  """The test set as evaluators read it, and readers of what is done to real motions."""
  protocol = asked.protocol
  readers = [*(reader for reader in (main, clip) if reader), *readers]
  if protocol.joints_layout:
    readers.append(Reader("joints", get_layout(protocol.joints_layout), main.mode))
  return read_test_set(asked.folders, protocol, readers, allow_shared)


def _about(test_set, protocol):
  return (f"{protocol.title}: {len(test_set)} items of split {protocol.split!r}"
          + (f", {len(test_set.excluded)} clips left out" if test_set.excluded else "")
          + (f", {len(test_set.shared)} clips in train, too" if test_set.shared else ""))


def _harness(asked, main, clip, test_set, seed) -> Harness:
  protocol = asked.protocol.of_few(min(len(test_set), asked.limit or len(test_set)))
  return Harness(protocol, main, clip, test_set, protocol.seed if seed is None else int(seed), asked.limit)


def _check_out(out, question):
  """A folder that was not named must not hold the answer to another question."""
  if (out / FILE).is_file():
    before = Result.read(out).provenance.get("question")
    if before is not None and before != aggregates.json_ready(question):
      other = ", ".join(name for name in question if before.get(name) != aggregates.json_ready(question)[name])
      raise ValueError(f"{out} holds a result of another {other}, which would be lost; name a folder by --out")
