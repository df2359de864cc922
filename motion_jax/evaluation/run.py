"""Evaluates models on data by a protocol: rows of real and generated motions with intervals, and their provenance."""
import contextlib
import dataclasses
import json
import pathlib
import time
from collections.abc import Iterator
from functools import partial

import jax

from motion_jax.evaluation import aggregates, external, provenance, samples
from motion_jax.evaluation.candidates import Choices, Loaded, Reader, load_candidates
from motion_jax.evaluation.checks import controls as controls_lib
from motion_jax.evaluation.checks import sanity as sanity_lib
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.report import differences as difference_tables
from motion_jax.evaluation.report import gallery, printed, tables
from motion_jax.evaluation.request import Request, Resolved, default_out, load_evaluators, resolve
from motion_jax.evaluation.result import FILE, Result
from motion_jax.evaluation.tasks.registry import TASKS
from motion_jax.evaluation.test_set import TestSet, read_test_set
from motion_jax.motion.representations import get_layout
from motion_jax.utils.atomic import atomic_path

TABLES = {"tables.md": difference_tables.whole(tables.markdown), "tables.tex": difference_tables.whole(tables.latex),
          "tables.csv": tables.csv}


def evaluate(request: Request) -> Result:
  """Evaluates the models of a request, and writes results.json and tables in its folder."""
  clock, devices = Clock(request.verbose), tuple(request.devices or jax.local_devices())
  resolved = resolve(request)
  task_class = TASKS[resolved.protocol.task]
  folder = pathlib.Path(request.out) if request.out else default_out(request.runs, resolved.protocol)
  main, clip = load_evaluators(resolved.protocol, request.evaluator, request.clip_evaluator)
  candidates, left_out = _load(request, resolved.protocol, task_class, main, folder, devices)
  for note in left_out:
    clock.say(f"note: {note}")
  with clock.part("data"):
    readers = [] if task_class.TEXT_TO_MOTION else [candidate.reader for candidate in candidates]
    test_set = read_for(resolved, main, clip, readers)
    clock.say(_about(test_set, resolved.protocol))
  harness = _harness(resolved, main, clip, test_set)
  protocol, task = harness.protocol, task_class(harness)
  if not request.out:
    _check_out(folder, provenance.question(harness, candidates))

  replications = range(protocol.replications if request.replications is None else request.replications)
  with clock.part("real data"):
    sanity = sanity_lib.check(harness)
    sanity_lib.require(sanity, request.force)
    for warning in sanity["warnings"]:
      clock.say(f"warning: {warning}")
    rows, curves = aggregates.collect(map(task.real, replications), protocol.population_std)
  row_sources, by_motion, notes = {}, {}, []
  for candidate in candidates:
    with clock.part(candidate.name):
      scored = [task.score(candidate, replication) for replication in replications]
      part_rows, drawn = aggregates.collect(scored, protocol.population_std)
    named = partial(aggregates.row_name, candidate.name)
    by_motion |= {named(part): [scores.by_motion[part] for scores in scored] for part in scored[0].by_motion}
    notes += [f"{named(part)}: {note}" for part, note in scored[0].notes.items()]
    row_sources |= {named(part): (candidate, part) for part in part_rows}
    rows |= {named(part): row for part, row in part_rows.items()}
    curves |= {named(part): curve for part, curve in drawn.items()}
  with clock.part("differences"):
    compared = aggregates.compared(row_sources, by_motion, harness.seed)
    uncertain = aggregates.uncertain(harness, row_sources, by_motion, compared)
  checked = None
  if request.controls:
    with clock.part("controls"):
      checked = controls_lib.check(task, spread=aggregates.spread(rows["real"]))

  result = Result(**aggregates.json_ready(dict(
      protocol=protocol.name, title=protocol.title, rows=rows, row_order=["real", *row_sources],
      metrics=[name for name in task.METRICS if any(name in row for row in rows.values())],
      paper=printed.paper_of(protocol, main, row_sources, resolved.whole),
      notes=[note for note in (protocol.note, *uncertain, *task.notes, *notes, *left_out) if note],
      provenance=provenance.describe(harness, resolved.folders, candidates, len(replications), devices),
      sanity=sanity, controls=checked, differences=compared,
      curves=aggregates.guidance_curves(rows, candidates) | (controls_lib.curves(checked) if checked else {})
      | aggregates.transition_curves(curves, protocol.population_std))))
  if candidates and task.TEXT_TO_MOTION:
    with clock.part("gallery"):
      result = dataclasses.replace(result, gallery=gallery.write(task, candidates[0], folder))
  return write(result, folder, clock.seconds)


def _load(request, protocol, task_class, main, folder, devices) -> Loaded:
  """The candidates of a request: its runs, and folders of motions that other programs generated, with notes on both."""
  choices = Choices(tuple(request.guidance_scales), dict(request.sampling), tuple(request.vary) or ({},),
                    task_class.OPTIONS)
  load = partial(task_class.load, raw=request.weights == "model")
  candidates, left_out = load_candidates(request.runs, load, choices, folder, request.samples, devices,
                                         request.recompute, request.verbose)
  tail = samples.TAIL if protocol.made_padding == "decoded" else 0
  others = [external.load_external(name, place, main, not task_class.FITS_GIVEN, request.as_given, tail)
            for name, place in request.motions]
  return Loaded([*candidates, *others], [*left_out, *(other.note for other in others if other.note)])


def export_prompts(request: Request, out) -> pathlib.Path:
  """Writes what a protocol asks another program to generate, with the real motions that it is based on: see
  `evaluation.external`. Of the request, the data, protocol, evaluator and draws are used."""
  resolved = resolve(request)
  main, _ = load_evaluators(resolved.protocol, request.evaluator, "none")
  reader = external.joint_reader(main)
  task = TASKS[resolved.protocol.task]
  harness = _harness(resolved, main, None, read_for(resolved, main, readers=[] if task.TEXT_TO_MOTION else [reader]))
  return external.export_prompts(
      task(harness), reader, out,
      harness.protocol.replications if request.replications is None else request.replications, _flags(request))


def _flags(request):
  """The flags of `motion-jax evaluate` that make a request draw what it draws."""
  values = dict(evaluator=getattr(request.evaluator, "name", request.evaluator), limit=request.limit,
                replications=request.replications, seed=request.seed)
  texts = [f"--{name} {value}" for name, value in values.items() if value is not None]
  return " ".join(texts + ["--no-multimodality"] * (not request.multimodality)
                  + ["--allow-shared"] * request.allow_shared)


def write(result, out, seconds=None) -> Result:
  """Writes results.json, tables and timings.json in a folder; returns the result with its folder."""
  for name, text in {name: form(result) for name, form in TABLES.items()}.items():
    _write(pathlib.Path(out) / name, text)
  _write(pathlib.Path(out) / "timings.json", json.dumps(seconds or {}, indent=1) + "\n")
  return result.write(out)


def _write(path, text):
  with atomic_path(path) as place:
    place.write_text(text, encoding="utf-8")


class Clock:
  """Reports progress and measures the time of each part."""

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


def read_for(resolved: Resolved, main, clip=None, readers=()) -> TestSet:
  """The test set, in the representations of the evaluators and of further readers."""
  protocol = resolved.protocol
  readers = [*(reader for reader in (main, clip) if reader), *readers]
  if protocol.joints_layout:
    readers.append(Reader("joints", get_layout(protocol.joints_layout), main.mode))
  return read_test_set(resolved.folders, protocol, readers, resolved.request.allow_shared)


def _about(test_set, protocol):
  return (f"{protocol.title}: {len(test_set)} items of split {protocol.split!r}"
          + (f", {len(test_set.excluded)} clips left out" if test_set.excluded else "")
          + (f", {len(test_set.shared)} clips in train, too" if test_set.shared else ""))


def _harness(resolved, main, clip, test_set) -> Harness:
  protocol, seed = resolved.protocol.of_few(min(len(test_set), resolved.limit or len(test_set))), resolved.request.seed
  return Harness(protocol, main, clip, test_set, protocol.seed if seed is None else int(seed), resolved.limit)


def _check_out(out, question):
  """Raises ValueError where the default folder holds the result of another request."""
  if (out / FILE).is_file():
    before = Result.read(out).provenance.get("question")
    if before is not None and before != aggregates.json_ready(question):
      other = ", ".join(name for name in question if before.get(name) != aggregates.json_ready(question)[name])
      raise ValueError(f"{out} holds a result of another {other}, which would be lost; name a folder by --out")
