"""From a config to a trained run folder: what `motion-jax train` calls, and training from Python.

    from motion_jax import fit
    from motion_jax.utils import config_files
    fit.run(config_files.load("cmdm_denoiser:tiny"), "runs/tiny")
"""
import contextlib
import pathlib
import time

import flax
import jax

from motion_jax import pictures, runs
from motion_jax.data import sources
from motion_jax.evaluators import setup as evaluators
from motion_jax.evaluators import validation
from motion_jax.latents import TOKENIZER
from motion_jax.models import registry
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.representations import get_layout
from motion_jax.training import checkpoint, distributed, lock, loop, metrics
from motion_jax.training import setup as training_setup
from motion_jax.training.optimizers import is_schedule_free
from motion_jax.utils import atomic, config_files, plugins
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean


def setups() -> dict:
  """{stage: function(config) -> TrainingSetup} of all that can be trained."""
  return registry.setups() | evaluators.SETUPS


DTYPES = ("float32", "bfloat16")  # that networks may compute in
# Files of a run folder that are written before the first step, besides those that a stage gives it.
FILES = (checkpoint.CONFIG, checkpoint.DATA, checkpoint.FROZEN, "Mean.npy", "Std.npy")


def run(config, workdir, resume=False, max_seconds=None, stop=None, allow_changes=False,
        profile_steps=None):
  """Trains the stage that config.stage names in the folder workdir; returns the last TrainState.

  A config with passes (configs/shipped) trains each of them in a folder of its own below workdir, see `run_passes`.
  resume: True continues the run in the folder; "auto" does if there is one, and starts one otherwise. max_seconds,
  stop: save and end early (`training.loop.train`). allow_changes: continue with another config or other data than
  before. profile_steps: (first, last) are traced. Raises ValueError for a config that cannot run.
  """
  if "passes" in config:
    return run_passes(config, workdir, resume, max_seconds, stop, allow_changes)
  plugins.import_modules(config)
  known = setups()
  _check_stage(config, known)
  workdir = pathlib.Path(workdir)
  config, about_data = resolve(config)
  _check_freeze(config)
  if resume == "auto":
    resume = not checkpoint.is_fresh(workdir)
    print(f"--resume=auto: {'resuming' if resume else 'starting'} {workdir}")
  processes = f" of {jax.process_count()} processes" if jax.process_count() > 1 else ""
  print(f"{config.stage} in {workdir} on {jax.device_count()} {jax.default_backend()} device(s){processes}")
  print(*(f"  {line}" for line in config_files.lines_of(config)), sep="\n")
  print(about_data or "data: being read", flush=True)
  if resume and (workdir / checkpoint.CONFIG).is_file():
    before = runs.load_run(workdir).config
    config = training_setup.epochs_as_before(config, before)
    training_setup.check_config(config, before, allow_changes)
  setup = validation.with_fid(known[config.stage](config), config)
  config = training_setup.resolve_epochs(config, setup.num_items)
  metrics.check_profile_steps(profile_steps, config.train.num_steps)
  stage, next_batch, frozen, evaluate, stats, files, num_items = setup
  print(f"training: {training_setup.describe_length(config, num_items)}")
  if stage.about_loss:
    print(f"loss: {stage.about_loss}", flush=True)
  draw = pictures.drawer(config, workdir, setup)
  if config.train.start:
    stage = _started_from(stage, config)
  workdir.mkdir(parents=True, exist_ok=True)
  first = distributed.is_first()  # of several processes, this one writes
  with lock.locked(workdir) if first else contextlib.nullcontext():
    resumes = not checkpoint.is_fresh(workdir)
    if resumes and not resume:
      raise ValueError(f"{workdir} holds a run already; --resume continues it, or choose another folder")
    if resumes:
      frozen = training_setup.frozen_as_before(workdir, stats, frozen, files)
    files = files | {checkpoint.DATA: training_setup.digests(workdir, config, resumes, allow_changes)}
    distributed.wait_for_all("the folder is read")
    if first:
      _write_folder(workdir, config, stats, frozen, files)
    state = loop.train(config, workdir, stage, next_batch, frozen, resume, evaluate, max_seconds, stop,
                        profile_steps, draw)
    distributed.wait_for_all("the run has ended")  # the first one may still be writing
    written = [name for name in (checkpoint.PARAMS, metrics.METRICS, "loss.png") if
               (pathlib.Path(workdir) / name).is_file()]
    if checkpoint.PARAMS not in written:
      raise OSError(f"{workdir}: {checkpoint.PARAMS} could not be written, see the lines above; free some space and "
                    "continue with --resume")
    print(f"wrote {workdir}/{', '.join(written)} at step {int(state.step)}")
  return state


def _check_stage(config, known):
  if config.stage not in known:
    raise ValueError(f"got stage {config.stage!r}{did_you_mean(config.stage, known)}, expected one of "
                     f"{', '.join(known)}{registry.missing(config.stage)}")
  metrics.check_tensorboard(config)
  if (dtype := config.train.get("dtype", DTYPES[0])) not in DTYPES:
    raise InputError(f"got train.dtype {dtype!r}, expected {' or '.join(DTYPES)}")


def _check_freeze(config):
  if config.train.freeze and not config.train.start:
    raise InputError(f"got train.freeze {tuple(config.train.freeze)} without train.start, expected the run whose "
                     "parameters are to be frozen")
  if config.train.freeze and is_schedule_free(config.optimizer):
    raise InputError(f"got train.freeze with optimizer.name {config.optimizer.name!r}, whose average would move what "
                     "is frozen; choose another optimizer, such as adamw")


def _write_folder(workdir, config, stats, frozen, files):
  """Writes what a run folder holds before the first step."""
  atomic.remove_strays(workdir, (*FILES, *files))
  checkpoint.save_config(workdir, config)
  stats_lib.save_stats(stats, workdir)
  if frozen:  # a run folder is all that loading needs
    checkpoint.save_params(workdir, frozen, name=checkpoint.FROZEN)
  for name, text in files.items():
    checkpoint.save_text(workdir, name, text)


def run_passes(config, workdir, resume=False, max_seconds=None, stop=None, allow_changes=False):
  """Trains the passes of a recipe one after the other, each in workdir/NAME; returns the last TrainState, if any.

  config.passes: dicts with a "name" and either "config", NAME:SIZE of a stage, with "fields" {SECTION.FIELD: value}, or
  "combine", a function of `motion_jax.runs`, with "runs", the folders that it takes. "{NAME}" in a value stands for
  the folder of an earlier pass. Resuming skips passes that are finished and continues in the one that is not.
  """
  began, workdir, state = time.monotonic(), pathlib.Path(workdir), None
  folder_of = {section["name"]: workdir / section["name"] for section in config.passes}
  if not resume and (existing := next((folder for folder in folder_of.values() if folder.exists()), None)):
    raise ValueError(f"{existing} is there already; --resume continues the recipe, or choose another folder")
  with sources.keep_features():  # passes on the same data make its clips once
    for number, section in enumerate(config.passes, 1):
      print(f"pass {number} of {len(config.passes)}: {section['name']}", flush=True)
      folder = folder_of[section["name"]]
      if "combine" in section:
        _combine(section, folder, folder_of)
        continue
      if _is_finished(folder):
        print(f"{folder} is finished", flush=True)
        continue
      left = max_seconds and max(max_seconds - (time.monotonic() - began), 1e-3)
      pass_config = config_of_pass(section, folder_of, config.archives, _seconds_of(section, config),
                                   config.get("workers", 0))
      state = run(pass_config, folder, "auto" if resume else False, left, stop, allow_changes)
      if not _is_finished(folder):
        break
  return state


def _combine(section, folder, folder_of):
  if not folder.exists():
    if distributed.is_first():
      made_of = [name.format(**folder_of) for name in section["runs"]]
      runs.COMBINATIONS[section["combine"]](*made_of, folder)
    distributed.wait_for_all(f"{folder} is written")


def _seconds_of(one, config):
  """The share of a pass in config.seconds; 0: no limit."""
  return config.get("seconds", 0.0) * one.get("share", 0) / max(sum(each.get("share", 0) for each in config.passes), 1)


def config_of_pass(one, folder_of, archives="", seconds=0.0, workers=0):
  """The config of a pass that trains a stage. folder_of: {NAME: folder} of the passes; archives: the folder that holds
  the archives that the pass names; seconds: train.seconds, 0 for all steps; workers: data.workers."""
  config = config_files.load(one["config"])
  folders = tuple(str(pathlib.Path(archives) / name) for name in one.get("archives", ()))
  filled = lambda value: value.format(**folder_of) if isinstance(value, str) else value
  with config.unlocked():
    if folders:
      config.data.update(folder=folders[0] if len(folders) == 1 else "", folders=folders if len(folders) > 1 else ())
    config.update_from_flattened_dict({field: filled(value) for field, value in one.get("fields", {}).items()})
    if seconds:
      config.train.seconds = seconds
    if workers and "workers" in config.data:
      config.data.workers = workers
  return config


def _is_finished(folder):
  """Whether the run in a folder has its last state, with the evaluation that follows it."""
  if checkpoint.is_fresh(folder) or not (folder / checkpoint.CONFIG).is_file():
    return False
  num_steps = checkpoint.load_config(folder).train.num_steps
  return (folder / "checkpoints" / str(num_steps)).is_dir() and (folder / "loss.png").is_file()


def encode(config, folder) -> str:
  """Writes in a folder the store of latents that a config trains on, for data.store; returns a line about it."""
  known = registry.stores()
  if config.stage not in known:
    raise ValueError(f"got stage {config.stage!r}, which trains on no latents; expected one of "
                     f"{', '.join(known)}")
  config, about_data = resolve(config)
  print(about_data or "data: being read", flush=True)
  return known[config.stage](config, folder)


def resolve(config):
  """(a copy of a config with every field that training reads and the run folder records, a line about its data).

  Fields that it leaves out get their defaults; the kind of its data folders and the sizes of its frozen parts are read
  from these. A config is changed nowhere else.
  """
  resolved = config.copy_and_resolve_references().unlock()
  resolved = runs.with_defaults(resolved)
  about_data = sources.recognize(resolved)
  for name, value in registry.resolved().get(config.stage, lambda config: {})(resolved).items():
    resolved[name] = value
  if config.stage.partition(".")[0] in registry.METHODS:
    _demand_layout(resolved)
  return resolved.lock(), about_data


def _demand_layout(config):
  """Raises InputError where networks of features take another number of them than the layout of the data has."""
  layout = get_layout(config.data.layout)
  for part in ("model", "tokenizer", "prior"):
    features = (config.get(part) or {}).get("features") or layout.dim
    if features != layout.dim:
      raise InputError(f"got {part}.features = {features}, layout {layout.name!r} has {layout.dim} numbers a frame; "
                       "make them agree")


def _started_from(stage, config):
  """The stage, initialized with the parameters of another run, a folder or a shipped name; parameters that it does not
  have start random. A tokenizer is also found inside a generator's run."""
  folder = config.train.start
  run = runs.load_run(folder)
  inside = run.stage != config.stage and runs.TOKENIZERS.get(run.stage) == config.stage
  start = flax.traverse_util.flatten_dict(run.frozen()[TOKENIZER] if inside else run.params())
  for field, name in (*(("freeze", name) for name in config.train.freeze),
                      *(("start_parts", name) for name in config.train.start_parts)):
    if not any(name in path for path in start):
      raise InputError(f"got train.{field} {name!r}, but train.start {folder} has no parameters of that name, only "
                       f"{', '.join(sorted({path[1] for path in start if len(path) > 1}))}")
  if config.train.start_parts:
    start = {path: value for path, value in start.items() if any(name in path for name in config.train.start_parts)}

  def init(batch, rng):
    initial = flax.traverse_util.flatten_dict(stage.init(batch, rng))
    shared = {path: initial[path] for path in initial.keys() & start.keys()}
    unused = start.keys() - initial.keys()
    if unused:
      raise ValueError(f"train.start {folder} has parameters that this config lacks, such as "
                       f"{'/'.join(sorted(unused)[0])}; make the models agree")
    checkpoint.check_fits(flax.traverse_util.unflatten_dict(start), flax.traverse_util.unflatten_dict(shared),
                          f"train.start {folder} does not fit this config")
    return flax.traverse_util.unflatten_dict({**initial, **start})

  return stage._replace(init=init)
