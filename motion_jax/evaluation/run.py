"""From runs, data and a protocol to a result: rows of real and made motions with intervals, and a record."""
import contextlib
import dataclasses
import itertools
import json
import pathlib
import time
from functools import partial

import jax

from motion_jax.evaluation import aggregates as rows_lib
from motion_jax.evaluation import given
from motion_jax.evaluation import protocols as protocols_lib
from motion_jax.evaluation import provenance as record_lib
from motion_jax.evaluation import test_set as items_lib
from motion_jax.evaluation.candidates import Reader, Subject, check_options, hash_of
from motion_jax.evaluation.checks import controls as controls_lib
from motion_jax.evaluation.checks import sanity
from motion_jax.evaluation.given import load_given
from motion_jax.evaluation.judge import Judge
from motion_jax.evaluation.report import gallery, printed, tables
from motion_jax.evaluation.tasks import editing, generation, long_horizon, reconstruction
from motion_jax.evaluation.tasks import timelines as mtt
from motion_jax.evaluators.evaluator import Evaluator, load_evaluator
from motion_jax.inputs import former_names
from motion_jax.motion.representations import get_layout
from motion_jax.runs import PRETRAINED, find
from motion_jax.runtime.atomic import atomic_path
from motion_jax.training import checkpoint

_TASKS = {"generation": generation, "reconstruction": reconstruction, "editing": editing, "stories": long_horizon,
          "timelines": mtt}


def evaluate(runs, folders, protocol=None, *, evaluator=None, clip_evaluator=None, out=None, repeats=None, seed=None,
             guidance=(), sampling=None, vary=(), limit=None, controls=False, multimodality=True, force=False,
             only_read=False, raw=False, devices=None, show=True, samples=None, motions=(), allow_shared=False) -> dict:
  """Judges runs (folders, or names that ship) on data folders by a protocol, and writes results.json in `out`.

  evaluator, clip_evaluator: names, folders or `Evaluator`s, the protocol's by default; clip_evaluator "none": no CLIP
  score. guidance: scales, a row each; the models' own by default. sampling: what else `generate` takes; vary: changes
  of it, a row each. limit: samples of a trial; of long motions, sequences or timelines. controls: damaged real motions,
  too. force: go on though real data does not look right. only_read: from samples that exist (reconstructions are none,
  they are always made). raw: the last weights of a run, not their average. devices: of jax; they change nothing but the
  time. samples: folder where motions are kept, for several evaluations to share; by default the run's, or of a model
  that ships `out`. motions: (name, folder) of what other programs made, see `evaluation.given`. allow_shared: judge
  clips that train has, too, and name them in the record.
  -> result: rows {name: {metric: {"mean", "interval", "values"}}}, record, sanity, controls, curves, gallery.
  """
  start, devices = Clock(show), tuple(devices or jax.local_devices())
  whole = limit is None
  folders, protocol, limit = _what(runs, folders, protocol, limit, multimodality)
  whole &= protocol.task != "stories" or bool(protocol.timelines or protocol.recorded)  # not stories of our own
  repeats = protocol.repeats if repeats is None else repeats
  main, clip = _evaluators(protocol, evaluator, clip_evaluator)
  default = out is None
  out = pathlib.Path(out) if out else default_out(runs, protocol)
  task = _TASKS[protocol.task]
  load = partial(task.load, raw=True) if raw else task.load
  choices = [former_names.current((sampling or {}) | one) for one in vary or ({},)]
  more = ("way",) if protocol.task in ("stories", "timelines") else ()
  subjects = _subjects(load, runs, out, samples, guidance, choices, more, devices, only_read, show)
  if motions and task is not generation:
    raise ValueError(f"motions of other programs are judged as text to motion, protocol {protocol.name!r} is not; name "
                     "another --protocol")
  with start.part("data"):
    items = _items(folders, protocol, main, clip, subjects if task is not generation else (), allow_shared, start)
  protocol = protocol.of_few(len(items))
  judge = Judge(protocol, main, clip, items, protocol.seed if seed is None else int(seed), limit)
  subjects += [load_given(name, folder, main) for name, folder in motions]
  if default:
    _check_out(out, record_lib.question(judge, subjects))
  with start.part("real data"):
    found = sanity.look(judge)
    sanity.demand(found, force)
    for warning in found["warnings"]:
      start.say(f"mind: {warning}")
    rows = rows_lib.collect(lambda repeat: task.real_rows(judge, repeat), repeats, protocol.population_std)
  made_by = {}
  for subject in subjects:
    with start.part(subject.name):
      made = rows_lib.collect(lambda repeat, subject=subject: task.rows(judge, subject, repeat), repeats,
                              protocol.population_std)
    rows |= {rows_lib.row_name(subject.name, part): row for part, row in made.items()}
    made_by |= {rows_lib.row_name(subject.name, part): (subject, part) for part in made}
  checked = None
  if controls:
    with start.part("controls"):
      checked = controls_lib.check(judge, task, spread=rows_lib.spread(rows["real"]))
  result = rows_lib.plain(dict(
      protocol=protocol.name, title=protocol.title, rows=rows, row_order=["real", *made_by],
      metrics=[name for name in task.METRICS if any(name in row for row in rows.values())],
      paper=printed.paper_of(protocol, main, made_by, whole),
      notes=[note for note in (protocol.note, *judge.kept.get("notes", ())) if note],
      record=record_lib.make_record(judge, folders, subjects, repeats, devices), sanity=found, controls=checked,
      curves=rows_lib.curves_of(rows, subjects, checked) | rows_lib.drawn(judge.curves, protocol.population_std),
      gallery=[]))
  if subjects and task is generation:
    with start.part("gallery"):
      result["gallery"] = gallery.write(judge, subjects[0], out)
  write(result, out, start.seconds)
  return result


def ask(folders, out, protocol=None, *, evaluator=None, repeats=None, seed=None, limit=None, multimodality=True,
        allow_shared=False) -> pathlib.Path:
  """Writes the captions and lengths that a protocol wants motions of, for another program to make; see
  `evaluation.given`."""
  folders, protocol, limit = _what((), folders, protocol, limit, multimodality)
  if protocol.task != "generation":
    raise ValueError(f"protocol {protocol.name!r} is not text to motion; name another --protocol")
  main, _ = _evaluators(protocol, evaluator, "none")
  items = _items(folders, protocol, main, None, (), allow_shared)
  protocol = protocol.of_few(len(items))
  judge = Judge(protocol, main, None, items, protocol.seed if seed is None else int(seed), limit)
  return given.ask(judge, out, protocol.repeats if repeats is None else repeats)


def write(result, out, seconds=None):
  """results.json and tables in a folder, and timings.json, which is no part of a result."""
  for name, text in (("results.json", json.dumps(result, indent=1, allow_nan=False) + "\n"),
                     ("tables.md", tables.markdown(result)), ("tables.tex", tables.latex(result)),
                     ("tables.csv", tables.csv(result)),
                     ("timings.json", json.dumps(seconds or {}, indent=1) + "\n")):
    with atomic_path(pathlib.Path(out) / name) as path:
      path.write_text(text, encoding="utf-8")


class Clock:
  """Says what is done, and where the time went."""

  def __init__(self, show):
    self.show, self.seconds = show, {}

  @contextlib.contextmanager
  def part(self, name):
    begin = time.perf_counter()
    yield
    self.seconds[name] = round(time.perf_counter() - begin, 2)
    self.say(f"{name}: {self.seconds[name]:.1f} s")

  def say(self, text):
    if self.show:
      print(text, flush=True)


# --- what is asked for -------------------------------------------------------------------------------------------


def _what(runs, folders, protocol, limit, multimodality):
  """(data folders, protocol for them, limit of samples) of what was asked; a file among the folders is of timelines
  or stories."""
  folders = list(folders)
  files = [folders.pop(i) for i in reversed(range(len(folders))) if pathlib.Path(folders[i]).is_file()]
  protocol = protocols_lib.get_protocol(protocol or guess_protocol(runs, [*folders, *files]))
  if files:
    if protocol.task not in ("stories", "timelines"):
      raise ValueError(f"{files[0]} is a file, protocol {protocol.name!r} takes data folders alone; stories go with "
                       "long-horizon and babel, timelines with mtt")
    protocol = dataclasses.replace(protocol, timelines=str(files[0]), note="")
  if protocol.task in ("stories", "timelines") and limit:
    protocol, limit = dataclasses.replace(protocol, sequences=limit), None
  protocol = protocol.on(items_lib.dataset_of_all(folders).judged_as)
  return folders, protocol if multimodality else generation.without_multimodality(protocol), limit


def _items(folders, protocol, main, clip, subjects, allow_shared, clock=None):
  """The test items for evaluators, and for what is done to real motions."""
  readers = [reader for reader in (main, clip) if reader] + [subject.reader for subject in subjects]
  if protocol.joints_layout:
    readers.append(Reader("joints", get_layout(protocol.joints_layout), main.mode))
  items = items_lib.read_items(folders, protocol, readers, allow_shared)
  if clock:
    clock.say(f"{protocol.title}: {len(items)} items of split {protocol.split!r}"
              + (f", {len(items.excluded)} clips left out" if items.excluded else "")
              + (f", {len(items.shared)} clips in train, too" if items.shared else ""))
  return items


def _check_out(out, question):
  """A folder that was not named must not hold the answer to another question."""
  if (out / "results.json").is_file():
    before = checkpoint.load_json(out, "results.json").get("record", {}).get("question")
    if before is not None and before != rows_lib.plain(question):
      other = ", ".join(name for name in question if before.get(name) != rows_lib.plain(question)[name])
      raise ValueError(f"{out} holds a result of another {other}, which would be lost; name a folder by --out")


def guess_protocol(runs, folders) -> str:
  """The protocol that fits data and model, by the data set and the layout of the first run."""
  data = [folder for folder in folders if not pathlib.Path(folder).is_file()]
  files = [folder for folder in folders if folder not in data]
  if files and pathlib.Path(files[0]).suffix == ".json":  # of stories
    return items_lib.dataset_of_all(data).long_horizon
  if files:
    return "mtt"
  return items_lib.dataset_of_all(data).benchmark(
      data, lambda: checkpoint.load_config(find(runs[0])).data.layout if runs else None)


def default_out(runs, protocol) -> pathlib.Path:
  """eval/PROTOCOL in the folder of the first run; of a model that ships, below the working directory."""
  folder = find(runs[0]) if runs else pathlib.Path("real")
  inside = folder.parent != PRETRAINED and runs
  return folder / "eval" / protocol.name if inside else pathlib.Path("eval") / folder.name / protocol.name


_TRAINS = {"t2m": "evaluator_matching", "tmr": "part_tmr",
           "snapmogen": "evaluator_snapmogen", "clip": "evaluator_clip"}


def _evaluators(protocol, evaluator, clip_evaluator):
  main, clip = evaluator or protocol.evaluator, clip_evaluator or protocol.clip_evaluator
  if main is None:
    raise ValueError(f"protocol {protocol.name!r} has no evaluator that ships: give --evaluator FOLDER, trained by "
                     f"`motion-jax train --config {_TRAINS[protocol.kinds[0]]}`, or converted from released weights "
                     "by `motion-jax convert evaluator`")
  return _evaluator(main, protocol.kinds, protocol, "--evaluator"), (
      None if clip in (None, "none") else _evaluator(clip, ("clip",), protocol, "--clip-evaluator"))


def _evaluator(one, kinds, protocol, option):
  """An evaluator of one of the kinds that a protocol's numbers are of."""
  found = one if isinstance(one, Evaluator) else load_evaluator(one)
  if found.kind not in kinds:
    raise ValueError(f"got {option} {found.name!r} of kind {found.kind!r}, protocol {protocol.name!r} is about the "
                     f"space of kind {' or '.join(kinds)}; {_TRAINS[kinds[0]]} trains one")
  return found


def _subjects(load, runs, out, home, guidance, choices, more, devices, only_read, show):
  subjects, varied = [], {key for one in choices for key in one if any(other.get(key) != one[key] for other in choices)}
  for name, run in zip(_names(runs), runs):
    loaded = load(run)
    if loaded.can("generate"):
      loaded.tells_unknown_words = False  # the record lists them once
    shipped = pathlib.Path(loaded.folder).parent == PRETRAINED
    folder = pathlib.Path(home) if home else (out if shipped else loaded.folder / "eval") / "samples"
    for scale, options in itertools.product(guidance or (None,), choices):
      check_options(name, loaded, guidance, options, more)
      row = name + "".join(f", {key} {value}" for key, value in options.items() if key in varied)
      if len(guidance) > 1:
        row += f", guidance {scale:g}"
      subjects.append(Subject(row, loaded, hash_of(loaded), folder, scale, options, devices, only_read, show))
  return subjects


def _names(runs):
  """The last part of each run's path, or the path where that is another's too or means something else in a result."""
  names = [find(run).resolve().name for run in runs]
  return [name if names.count(name) == 1 and name not in ("real", "shuffled") else str(run)
          for name, run in zip(names, runs)]
