"""Sweeps: several training runs of one file, one after another, in turns, or as tasks of a SLURM array, and a table.

  python benchmarks/sweep.py learning_rate --workdir runs/rates --data path/to/cmu path/to/bandai
  python benchmarks/sweep.py same_data --workdir runs/same-data --cpu-seconds 7200 --slice 300 --data ...

All other arguments are those of `motion-jax train`, for each run.

A sweep is a file with get_sweep(size) -> {name: (config, {field: value})}. A name METHOD/STAGE is a stage of a method,
whose stages are trained in the order of the file; "{METHOD/STAGE}" in a value stands for the folder of an earlier one.
With a third entry, (config, fields, share), a stage gets that share of its method's budget of processor time.
"""
import argparse
import importlib.util
import json
import math
import os
import pathlib
import subprocess
import sys
from typing import NamedTuple

from motion_jax.data.mocap import child
from motion_jax.utils import config_files, exit_status
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean
from motion_jax.utils.numerals import real

TASK = "SLURM_ARRAY_TASK_ID"
_DONE, _TABLE, _CHART, _RECORD = "finished", "sweep.md", "sweep.png", "sweep.json"


class Run(NamedTuple):
  """A run of a sweep: a config with changed fields; share: its part of the budget of its method."""
  config: str
  fields: dict
  share: float = 1.0


def load(name) -> dict[str, Run]:
  """{name: run} of a sweep: NAME[:SIZE] of configs/sweeps/, or FILE.py[:SIZE]."""
  file, _, size = str(name).partition(":")
  path, folder = pathlib.Path(file), config_files.FOLDER / "sweeps"
  if not path.is_file():
    own = file.removeprefix("configs/").removeprefix("sweeps/").removesuffix(".py")
    known = sorted(one.stem for one in folder.glob("*.py") if one.stem != "__init__")
    if own not in known:
      raise FileNotFoundError(f"there is no sweep {file!r}, expected the path of a Python file, or one of "
                              f"{', '.join(known)}{did_you_mean(own, known)}")
    path = folder / f"{own}.py"
  try:
    spec = importlib.util.spec_from_file_location("sweep", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    runs = module.get_sweep(size) if size else module.get_sweep()
    runs = {str(run): Run(str(config), dict(fields), *map(float, share)) for run, (config, fields, *share)
            in runs.items()}
  except Exception as error:  # any error of a file that is not a sweep
    raise InputError(f"{file} is not a sweep ({type(error).__name__}: {error}); expected Python with a function "
                     "get_sweep(size) -> {name: (config, {field: value})}, with a share after these where stages share "
                     "a budget") from error
  bad = [run for run in runs if run.count("/") > 1 or not all(
      part not in ("", ".", "..") and part == pathlib.PurePath(part).name for part in run.split("/"))]
  if not runs or bad:
    raise InputError(f"{file}: got {len(runs)} runs{f', one named {bad[0]!r}' if bad else ''}; expected at least one, "
                     "and names that are a folder's, or METHOD/STAGE")
  for method, names in methods_of(runs).items():
    total = sum(runs[one].share for one in names)
    if not (all(runs[one].share > 0 for one in names) and abs(total - 1) < 1e-6):
      raise InputError(f"{file}: got shares of {total:g} of the budget for the stages of {method!r}, expected shares "
                       "above 0 that add up to 1")
  order = list(runs)
  for number, (one, found) in enumerate(runs.items()):
    if later := [name for name in order[number:] if name in needs(found, order)]:
      raise InputError(f"{file}: {one!r} needs {later[0]!r}, which comes later or is itself; list it before")
  return runs


def methods_of(runs) -> dict[str, list[str]]:
  """{method: names of its runs, in order}; a run without a method is one of its own."""
  found = {}
  for one in runs:
    found.setdefault(one.partition("/")[0], []).append(one)
  return found


def needs(run, names) -> list[str]:
  """The runs whose folders a run names in its fields."""
  return [name for name in names if any(f"{{{name}}}" in value for value in run.fields.values()
                                        if isinstance(value, str))]


class Turns:
  """Which run of a sweep is trained next, by the states in the run folders alone, so that a sweep can be killed.

  Without a budget each unfinished run gets one turn, in order. With one, the method that has had the least processor
  time gets the next slice, in the first of its stages that has not spent its share; the stages that it needs come
  before it. When such a stage was trained further, by a larger budget, the stages made of it begin again, in a new
  folder: what they learned belongs to other latents.

  budget: processor seconds of a method; slice: of one turn, by default the rest of a stage's share.
  """

  def __init__(self, runs, workdir, budget=None, slice=None):
    self._runs, self._workdir, self._budget, self._slice = runs, pathlib.Path(workdir), budget, slice
    self._methods, self.left = methods_of(runs), list(runs)

  def next(self):
    """(name, the limit of its processor seconds or None), or None if nothing is left to train."""
    from motion_jax.training.saver import progress
    if self._budget is None:
      while self.left:
        one = self.left.pop(0)
        if _state(self._workdir / one) != _DONE:
          return one, None
        print(f"{one}: finished already", flush=True)
      return None
    open_methods = {}
    for method, names in self._methods.items():
      spent = {one: 0.0 if self._is_outdated(one) else progress(self._workdir / one)[1] for one in names}
      rest = [one for one in names if spent[one] < self._share(one) and _state(self._workdir / one) != _DONE
              or self._is_outdated(one)]
      if rest and rest[0] in self.left:
        open_methods[method] = (sum(spent.values()), rest[0])
    if not open_methods:
      return None
    _, one = min(open_methods.values(), key=lambda found: found[0])
    self._begin(one)
    share, end = self._share(one), progress(self._workdir / one)[1] + (self._slice or self._budget)
    return one, share if share - end < (self._slice or 0) / 2 else end  # no turn for a small rest

  def drop(self, one):
    """Gives the method of a run no further turns."""
    method = one.partition("/")[0]
    self.left = [name for name in self.left if name.partition("/")[0] != method]

  def _share(self, one):
    return self._budget * self._runs[one].share

  def _steps_of_needed(self, one):
    from motion_jax.training.saver import progress
    return {name: progress(self._workdir / name)[0] for name in needs(self._runs[one], self._runs)}

  def _is_outdated(self, one):
    return one in (record := _read_record(self._workdir)) and record[one] != self._steps_of_needed(one)

  def _begin(self, one):
    """Notes what a stage is made of; moves the folder of one that was made of less away."""
    from motion_jax.training import checkpoint
    from motion_jax.training.saver import progress
    folder = self._workdir / one
    if self._is_outdated(one) and folder.exists():
      folder.rename(folder.with_name(f"{folder.name}.{progress(folder)[1]:.0f}s"))
    record = _read_record(self._workdir) | {one: self._steps_of_needed(one)}
    checkpoint.save_text(self._workdir, _RECORD, json.dumps(record, indent=1) + "\n")


def _read_record(workdir):
  path = workdir / _RECORD
  return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def in_this_process(command) -> int:
  """Runs a command of `motion-jax` as `subprocess.call` does, but here, where data that were read once are kept."""
  import traceback

  import jax

  from motion_jax_studio import cli
  try:
    return cli.main(command[command.index("train"):])
  except Exception:  # as in a process of its own, which leaves the other runs alone
    traceback.print_exc()
    return 1
  finally:
    jax.clear_caches()  # the next run has programs of its own


def run(name, workdir, arguments, call=None, budget=None, slice=None) -> int:
  """Trains the unfinished runs of a sweep, each in workdir/NAME; writes workdir/sweep.md, and sweep.png if runs were
  measured on held-out clips.

  arguments: of `motion-jax train`, for each run. call(command) -> exit status runs one; by default in a process of its
  own, and slices, of which there are many, in this one. budget, slice: see `Turns`. In a SLURM array only the method
  of the task is trained. After a failed run the others are still trained; a stopped
  run ends the sweep, and the same command continues it. Returns the exit status.
  """
  if call is None and slice:
    from motion_jax.data import sources
    with sources.keep_features():
      return run(name, workdir, arguments, in_this_process, budget, slice)
  call = call or subprocess.call
  runs, workdir = load(name), pathlib.Path(workdir)
  workdir.mkdir(parents=True, exist_ok=True)
  turns = Turns(runs, workdir, budget, slice)
  turns.left = _of_this_task(runs)
  failed = []
  while turn := turns.next():
    one, limit = turn
    config, fields, _ = runs[one]
    folder = workdir / one
    folders = {name: str(workdir / name) for name in needs(runs[one], runs)}
    overrides = [f"--config.{field}={_filled(value, folders)}" for field, value in fields.items()]
    overrides += [f"--config.train.cpu_seconds={limit:.6g}"] if limit else []
    print(f"{one}: {config} {' '.join(overrides)}", flush=True)
    before = _spent(folder)
    status = call(child.command("motion_jax_studio.cli", "train", "--config", config, "--workdir", folder,
                                "--resume=auto", *arguments, *overrides))
    write_table(runs, workdir)
    draw_chart(runs, workdir)
    if status == exit_status.PREEMPTED or status > 128 or status < 0:
      print(f"stopped in {one}; the same command resumes")
      return status if status > 0 else 128 - status
    if status or limit and _spent(folder) == before:
      failed.append(one)
      turns.drop(one)
  print(write_table(runs, workdir))
  if failed:
    print(f"{len(failed)} of {len(runs)} runs failed: {', '.join(failed)}", file=sys.stderr)
  return 1 if failed else 0


def _of_this_task(runs):
  """The runs to train here: all, or in a SLURM array those of the method of the task."""
  methods = list(methods_of(runs).values())
  if TASK not in os.environ:
    return list(runs)
  try:
    return methods[int(os.environ[TASK])]
  except (ValueError, IndexError):
    raise InputError(f"got {TASK}={os.environ[TASK]}, expected a number from 0 to {len(methods) - 1}: the sweep has "
                     f"{len(methods)} methods") from None


def _filled(value, folders):
  """A value of a field with the folders of other runs in place of their names."""
  for name, folder in folders.items():
    value = value.replace(f"{{{name}}}", folder) if isinstance(value, str) else value
  return value


def _spent(folder):
  from motion_jax.training.saver import progress
  return progress(folder)[1]


def _state(folder):
  """The state of a run: "finished", "step K of N" or "not begun"."""
  from motion_jax.training.metrics import read_metrics
  from motion_jax.training.saver import progress
  rows = read_metrics(folder)
  try:
    last = json.loads((folder / "config.json").read_text(encoding="utf-8"))["train"]["num_steps"]
  except (OSError, ValueError, KeyError):
    return "not begun"
  step = max([progress(folder)[0], *(row["step"] for row in rows)])
  return _DONE if step >= last and (folder / "params.safetensors").is_file() else f"step {step} of {last}"


def write_table(runs, workdir) -> str:
  """Writes workdir/sweep.md, a row per run with its changes and latest numbers; returns the text."""
  from motion_jax.training.metrics import read_metrics
  from motion_jax.utils.atomic import atomic_path
  fields = list(dict.fromkeys(field for run in runs.values() for field in run.fields))
  given = {field: {str(run.fields.get(field, "")) for run in runs.values()} for field in fields}
  common = [field for field in fields if len(given[field]) == 1 and len(runs) > 1
            and all(field in run.fields for run in runs.values())]
  fields = [field for field in fields if field not in common]
  last = {}
  for one in runs:
    rows = read_metrics(workdir / one)
    last[one] = {key: value for row in rows for key, value in row.items()}  # the latest of each
    if spent := _spent(workdir / one):
      last[one]["cpu_seconds"] = spent
  numbers = ["loss", *dict.fromkeys(key for row in last.values() for key in row if key.startswith(("held_out", "r1")))]
  numbers += [key for key in ("cpu_seconds", "seconds") if key == "seconds" or any(key in row for row in last.values())]
  lines = ["| run | " + " | ".join([*fields, "state", *numbers]) + " |",
           "|" + " --- |" * (len(fields) + len(numbers) + 2)]
  for one, run in runs.items():
    cells = [str(run.fields.get(field, "")) for field in fields] + [_state(workdir / one)]
    cells += [f"{last[one][key]:.5g}" if isinstance(last[one].get(key), int | float) and math.isfinite(last[one][key])
              else "" for key in numbers]
    lines.append(f"| {one} | " + " | ".join(cells) + " |")
  if common:
    lines += ["", "In all runs: " + ", ".join(f"{field} {given[field].pop()}" for field in common)]
  text = "\n".join(lines) + "\n"
  with atomic_path(workdir / _TABLE) as path:
    path.write_text(text, encoding="utf-8")
  return text


def draw_chart(runs, workdir):
  """Writes workdir/sweep.png: a panel for each held-out metric, with a curve per run over the steps.

  Writes nothing if no run has two points.
  """
  from PIL import Image

  from motion_jax import charts
  from motion_jax.training.metrics import read_metrics
  from motion_jax.utils.atomic import atomic_path
  curves = {}
  for one in runs:
    for row in read_metrics(workdir / one):
      for name, value in row.items():
        if name.startswith("held_out"):
          curves.setdefault(name, {}).setdefault(one, []).append((row["step"], value))
  lines = {name: [charts.Series(one, *(zip(*found[one]) if one in found else ((), ()))) for one in runs]
           for name, found in curves.items() if max(map(len, found.values())) > 1}
  if not lines:
    return
  panels, names = [charts.picture(series, "step", name) for name, series in lines.items()], charts.legend(
      next(iter(lines.values())))
  image = Image.new("RGB", (sum(panel.width for panel in panels), panels[0].height + names.height), "white")
  for place, panel in enumerate(panels):
    image.paste(panel, (place * panel.width, 0))
  image.paste(names, (0, panels[0].height))
  with atomic_path(workdir / _CHART) as path:
    image.save(path, "PNG")


def parse(argv=None):
  """(arguments of this script, those of `motion-jax train`)."""
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
  parser.add_argument("sweep", metavar="NAME[:SIZE]", help="a sweep of configs/sweeps/, or a Python file")
  parser.add_argument("--workdir", required=True, metavar="FOLDER", help="folder of all runs; created if missing")
  parser.add_argument("--cpu-seconds", type=real(above=0, high=1e9, unit="processor seconds"), metavar="S",
                      help="processor time of each method, shared among its stages")
  parser.add_argument("--slice", type=real(above=0, high=1e9, unit="processor seconds"), metavar="S",
                      help="with --cpu-seconds: processor time of a turn; the method that has had the least is next")
  args, rest = parser.parse_known_args(argv)
  if args.slice and not args.cpu_seconds:
    parser.error("got --slice without --cpu-seconds, the budget of each method")
  if any(one.partition("=")[0] == "--config" for one in rest):
    parser.error("got --config, which the sweep's file names; --config.SECTION.FIELD=VALUE sets a field of all runs")
  return args, rest


def main(argv=None):
  args, rest = parse(argv)
  try:
    return run(args.sweep, args.workdir, rest, budget=args.cpu_seconds, slice=args.slice)
  except (InputError, OSError) as error:
    print(f"benchmarks/sweep.py: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
  sys.exit(main())
