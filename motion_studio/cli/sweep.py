"""Sweeps: several training runs of one file, in sequence or as tasks of a SLURM array, and a table of them."""
import importlib.util
import json
import math
import os
import pathlib
import subprocess
import sys

from motion_jax.utils import config_files, exit_status
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean

TASK = "SLURM_ARRAY_TASK_ID"
_DONE, _TABLE, _CHART = "finished", "sweep.md", "sweep.png"


def load(name) -> dict[str, tuple[str, dict]]:
  """{name of a run: (config, {field: value})} of a sweep: NAME[:SIZE] of configs/sweeps/, or FILE.py[:SIZE]."""
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
    runs = {str(run): (str(config), dict(fields)) for run, (config, fields) in runs.items()}
  except Exception as error:  # any error of a file that is not a sweep
    raise InputError(f"{file} is not a sweep ({type(error).__name__}: {error}); expected Python with a function "
                     "get_sweep(size) -> {name: (config, {field: value})}") from error
  bad = [run for run in runs if not run or run != pathlib.PurePath(run).name]
  if not runs or bad:
    raise InputError(f"{file}: got {len(runs)} runs{f', one named {bad[0]!r}' if bad else ''}; expected at least one, "
                     "and names that are a folder's")
  return runs


def run(name, workdir, arguments, call=subprocess.call) -> int:
  """Trains the unfinished runs of a sweep, each in workdir/NAME; writes workdir/sweep.md, and sweep.png if runs were
  measured on held-out clips.

  arguments: of `motion-jax train`, for each run. In a SLURM array only the run of the task is trained. After a failed
  run the others are still trained; a stopped run ends the sweep. Returns the exit status.
  """
  runs, workdir = load(name), pathlib.Path(workdir)
  names = list(runs)
  if TASK in os.environ:
    try:
      names = [names[int(os.environ[TASK])]]
    except (ValueError, IndexError):
      raise InputError(f"got {TASK}={os.environ[TASK]}, expected a number from 0 to {len(names) - 1}: the sweep has "
                       f"{len(names)} runs") from None
  statuses = {}
  for one in names:
    config, fields = runs[one]
    folder = workdir / one
    if _state(folder) == _DONE:
      print(f"{one}: finished already", flush=True)
      continue
    overrides = [f"--config.{field}={value}" for field, value in fields.items()]
    print(f"{one}: {config} {' '.join(overrides)}", flush=True)
    statuses[one] = call([sys.executable, "-m", "motion_studio.cli", "train", "--config", config,
                          "--workdir", str(folder),
                          "--resume=auto", *arguments, *overrides])
    write_table(runs, workdir)
    draw_chart(runs, workdir)
    if statuses[one] == exit_status.PREEMPTED or statuses[one] > 128 or statuses[one] < 0:
      print(f"stopped in {one}; the same command resumes")
      return statuses[one] if statuses[one] > 0 else 128 - statuses[one]
  print(write_table(runs, workdir))
  failed = [one for one, status in statuses.items() if status]
  if failed:
    print(f"{len(failed)} of {len(names)} runs failed: {', '.join(failed)}", file=sys.stderr)
  return 1 if failed else 0


def _state(folder):
  """The state of a run: "finished", "step K of N" or "not begun"."""
  from motion_jax.training.metrics import read_metrics
  rows = read_metrics(folder)
  try:
    last = json.loads((folder / "config.json").read_text(encoding="utf-8"))["train"]["num_steps"]
  except (OSError, ValueError, KeyError):
    return "not begun"
  step = max((row["step"] for row in rows), default=0)
  return _DONE if step >= last and (folder / "params.safetensors").is_file() else f"step {step} of {last}"


def write_table(runs, workdir) -> str:
  """Writes workdir/sweep.md, a row per run with its changes and latest numbers; returns the text."""
  from motion_jax.training.metrics import read_metrics
  from motion_jax.utils.atomic import atomic_path
  fields = list(dict.fromkeys(field for _, changed in runs.values() for field in changed))
  given = {field: {str(changed.get(field, "")) for _, changed in runs.values()} for field in fields}
  common = [field for field in fields if len(given[field]) == 1 and len(runs) > 1]
  fields = [field for field in fields if field not in common]
  last = {}
  for one in runs:
    rows = read_metrics(workdir / one)
    last[one] = {key: value for row in rows for key, value in row.items()}  # the latest of each
  numbers = ["loss", *dict.fromkeys(key for row in last.values() for key in row if key.startswith(("held_out", "r1")))]
  numbers += ["seconds"]
  lines = ["| run | " + " | ".join([*fields, "state", *numbers]) + " |",
           "|" + " --- |" * (len(fields) + len(numbers) + 2)]
  for one, (_, changed) in runs.items():
    cells = [str(changed.get(field, "")) for field in fields] + [_state(workdir / one)]
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
