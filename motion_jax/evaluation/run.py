"""From runs, data and a protocol to a result: rows of real and made motions with intervals, and a record."""
import contextlib
import dataclasses
import itertools
import json
import math
import pathlib
import time
from functools import partial

import jax
import numpy as np

from motion_jax import checkpoint
from motion_jax import model as model_lib
from motion_jax.data import humanml3d
from motion_jax.data.clip import atomic_path
from motion_jax.evaluation import controls as controls_lib
from motion_jax.evaluation import editing, gallery, generation, long_horizon, mtt, reconstruction, sanity, tables
from motion_jax.evaluation import items as items_lib
from motion_jax.evaluation import protocols as protocols_lib
from motion_jax.evaluation import record as record_lib
from motion_jax.evaluation.evaluator import Evaluator, load_evaluator
from motion_jax.evaluation.judge import Judge
from motion_jax.evaluation.subject import Subject, folder_of, hash_of
from motion_jax.motion.features import get_layout
from motion_jax.motion.skeleton import KIT

_TASKS = {"generation": generation, "reconstruction": reconstruction, "editing": editing, "stories": long_horizon,
          "timelines": mtt}
_BY_LAYOUT = {"coordinates": "cdamd-66", "essential": "cmdm-67", "full": "cmdm-259"}


def evaluate(runs, folders, protocol=None, *, evaluator=None, clip_evaluator=None, out=None, repeats=None, seed=None,
             guidance=(), sampling=None, vary=(), limit=None, controls=False, multimodality=True, force=False,
             only_read=False, raw=False, devices=None, show=True, samples=None) -> dict:
  """Judges runs (folders, or names that ship) on data folders by a protocol, and writes results.json in `out`.

  evaluator, clip_evaluator: names, folders or `Evaluator`s, the protocol's by default; clip_evaluator "none": no CLIP
  score. guidance: scales, a row each; the models' own by default. sampling: what else `generate` takes; vary: changes
  of it, a row each. limit: samples of a trial; of long motions, sequences or timelines. controls: damaged real motions,
  too. force: go on though real data does not look right. only_read: from samples that exist. raw: the last weights of a
  run, not their average. devices: of jax; they change nothing but the time. samples: folder where motions are kept, for
  several evaluations to share; by default the run's, or of a model that ships `out`.
  -> result: rows {name: {metric: {"mean", "interval", "values"}}}, record, sanity, controls, curves, gallery.
  """
  start = Clock(show)
  folders = list(folders)
  files = [folders.pop(i) for i in reversed(range(len(folders))) if pathlib.Path(folders[i]).is_file()]
  protocol = protocols_lib.get_protocol(protocol or guess_protocol(runs, folders))
  if files:
    protocol = dataclasses.replace(protocol, timelines=str(files[0]))
  if protocol.task in ("stories", "timelines") and limit:
    protocol, limit = dataclasses.replace(protocol, sequences=limit), None
  protocol = protocol.on(items_lib.format_of_all(folders))
  protocol = protocol if multimodality else generation.without_multimodality(protocol)
  repeats, seed = repeats or protocol.repeats, protocol.seed if seed is None else int(seed)
  devices = tuple(devices or jax.local_devices())
  main, clip = _evaluators(protocol, evaluator, clip_evaluator)
  out = pathlib.Path(out) if out else default_out(runs, protocol)
  task = _TASKS[protocol.task]
  load = partial(task.load, raw=True) if raw else task.load
  choices = [(sampling or {}) | one for one in vary or ({},)]
  subjects = _subjects(load, runs, out, samples, guidance, choices, devices, only_read, show)
  readers = [reader for reader in (main, clip) if reader]
  if task is not generation:
    readers += [subject.reader for subject in subjects]
  with start.part("data"):
    items = items_lib.read_items(folders, protocol, readers)
    start.say(f"{protocol.title}: {len(items)} items of split {protocol.split!r}"
              + (f", {len(items.excluded)} clips left out" if items.excluded else ""))
  judge = Judge(protocol, main, clip, items, seed, limit)
  with start.part("real data"):
    found = sanity.look(judge)
    sanity.demand(found, force)
    rows = _collect(lambda repeat: task.real_rows(judge, repeat), repeats, protocol.population_std)
  for subject in subjects:
    with start.part(subject.name):
      made = _collect(lambda repeat, subject=subject: task.rows(judge, subject, repeat), repeats,
                      protocol.population_std)
    rows |= {_row_name(subject.name, part): row for part, row in made.items()}
  checked = None
  if controls:
    with start.part("controls"):
      checked = controls_lib.check(judge)
  result = plain(dict(
      protocol=protocol.name, title=protocol.title, rows=rows,
      row_order=["real"] + [name for name in rows if name not in ("real", "shuffled")],
      metrics=[name for name in task.METRICS if any(name in row for row in rows.values())],
      paper=_paper(protocol, main), record=record_lib.make_record(judge, folders, subjects, repeats, devices),
      sanity=found, controls=checked, curves=_curves(rows, subjects, checked) | _drawn(judge.curves), gallery=[]))
  if subjects and protocol.task == "generation":
    with start.part("gallery"):
      result["gallery"] = gallery.write(judge, subjects[0], out)
  write(result, out, start.seconds)
  return result


def write(result, out, seconds=None):
  """results.json, tables.md, tables.tex in a folder, and timings.json, which is no part of a result."""
  for name, text in (("results.json", json.dumps(result, indent=1, allow_nan=False) + "\n"),
                     ("tables.md", tables.markdown(result)), ("tables.tex", tables.latex(result)),
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


def guess_protocol(runs, folders) -> str:
  """The protocol that fits data and model, by the format of the data and the layout of the first run."""
  data = [folder for folder in folders if not pathlib.Path(folder).is_file()]
  if len(data) < len(folders):
    return "mtt"  # a file of timelines
  data_format = items_lib.format_of_all(data)
  if data_format != "humanml3d":
    return {"archive": "archives-66"}.get(data_format, data_format)
  name = (checkpoint.load_config(folder_of(runs[0])).data.layout if runs
          else humanml3d.dataset_info(folders[0])["layout"])
  layout = get_layout(name)
  return "kit" if layout.skeleton is KIT else _BY_LAYOUT.get(layout.kind, "cmdm-259")


def default_out(runs, protocol) -> pathlib.Path:
  """eval/PROTOCOL in the folder of the first run; of a model that ships, below the working directory."""
  folder = folder_of(runs[0]) if runs else pathlib.Path("real")
  inside = folder.parent != model_lib.PRETRAINED and runs
  return folder / "eval" / protocol.name if inside else pathlib.Path("eval") / folder.name / protocol.name


def _evaluators(protocol, evaluator, clip_evaluator):
  main, clip = evaluator or protocol.evaluator, clip_evaluator or protocol.clip_evaluator
  if main is None:
    raise ValueError(f"protocol {protocol.name!r} has no evaluator that ships: give --evaluator FOLDER, trained with "
                     "configs/evaluator_matching.py, or converted from released weights by `motion-jax convert "
                     "evaluator`")
  load = lambda one: one if isinstance(one, Evaluator) else load_evaluator(one)
  return load(main), None if clip in (None, "none") else load(clip)


def _subjects(load, runs, out, home, guidance, choices, devices, only_read, show):
  subjects, names = [], [pathlib.Path(folder_of(run)).name for run in runs]
  names = [name if names.count(name) == 1 else str(run) for name, run in zip(names, runs)]
  varied = {key for one in choices for key in one if any(other.get(key) != one[key] for other in choices)}
  for name, run in zip(names, runs):
    loaded = load(run)
    shipped = pathlib.Path(loaded.folder).parent == model_lib.PRETRAINED
    folder = pathlib.Path(home) if home else (out if shipped else loaded.folder / "eval") / "samples"
    for scale, options in itertools.product(guidance or (None,), choices):
      row = name + "".join(f", {key} {value}" for key, value in options.items() if key in varied)
      if len(guidance) > 1:
        row += f", guidance {scale:g}"
      subjects.append(Subject(row, loaded, hash_of(loaded), folder, scale, options, devices, only_read, show))
  return subjects


def _paper(protocol, evaluator):
  fits = protocol.paper_layout in (None, evaluator.layout.name)
  return dict(zip(("system", "table", "row"), protocol.paper)) if protocol.paper and fits else None


# --- rows --------------------------------------------------------------------------------------------------------


def _collect(of_repeat, repeats, population):
  """{row: {metric: {"mean", "interval", "values"}}} of of_repeat(repeat) -> {row: {metric: number}}."""
  values = {}
  for repeat in range(repeats):
    for row, numbers in of_repeat(repeat).items():
      for metric, number in numbers.items():
        values.setdefault(row, {}).setdefault(metric, []).append(number)
  return {row: {metric: interval(numbers, population) for metric, numbers in found.items()}
          for row, found in values.items()}


def interval(values, population=True) -> dict:
  """Mean and half width of the 95 % interval over repeats, 1.96 std / sqrt(R)."""
  values = np.asarray(values, np.float64)
  half = 1.96 * values.std(ddof=0 if population or len(values) < 2 else 1) / math.sqrt(len(values))
  return dict(mean=float(values.mean()), interval=float(half), values=values.tolist())


def _row_name(name, part):
  return f"{part}: {name}" if part else name


def _curves(rows, subjects, checked):
  """FID against guidance where several scales were asked for, R-precision against noise where controls ran."""
  curves = {}
  for name in dict.fromkeys(subject.name.partition(", guidance")[0] for subject in subjects):
    own = [s for s in subjects if s.name.startswith(f"{name}, guidance") and "fid" in rows.get(s.name, {})]
    own.sort(key=lambda subject: subject.guidance_scale)
    if own:
      for metric, label in (("fid", "FID"), ("top3", "R@3")):
        if metric not in rows[own[0].name]:
          continue
        found = [rows[subject.name][metric] for subject in own]
        curves[f"{label} against guidance, {name}"] = dict(
            x=[subject.guidance_scale for subject in own], y=[one["mean"] for one in found],
            interval=[one["interval"] for one in found], x_label="guidance scale", y_label=label)
  return curves | (controls_lib.curves(checked) if checked else {})


def _drawn(curves):
  """Jerk across transitions, mean over repeats, of the rows whose task draws it."""
  made = {}
  for name, rows in curves.items():
    found = [interval(values) for values in np.transpose(rows)]
    half = (len(found) - 1) / 2
    made[f"jerk across transitions, {name}"] = dict(
        x=[i - half for i in range(len(found))], y=[one["mean"] for one in found],
        interval=[one["interval"] for one in found], x_label="frames from the border", y_label="jerk")
  return made


def plain(value):
  """Only what JSON knows: numbers that are not finite are null."""
  if isinstance(value, dict):
    return {str(key): plain(one) for key, one in value.items()}
  if isinstance(value, list | tuple):
    return [plain(one) for one in value]
  if isinstance(value, np.generic):
    value = value.item()
  if isinstance(value, float) and not math.isfinite(value):
    return None
  if dataclasses.is_dataclass(value):
    return plain(dataclasses.asdict(value))
  return value
