"""From a config to a trained run folder: a training set-up, the loop and the folder. What `motion-jax train` calls."""
import contextlib
import pathlib

import flax
import jax

from motion_jax import pictures, runs
from motion_jax.data import sources
from motion_jax.evaluators import setup as evaluators
from motion_jax.evaluators import validation
from motion_jax.latents import TOKENIZER
from motion_jax.models import registry
from motion_jax.motion import stats as stats_lib
from motion_jax.training import checkpoint, distributed, loop, metrics, progress
from motion_jax.training import resume as resuming
from motion_jax.training.optimizers import is_schedule_free
from motion_jax.utils import atomic, config_files, lock
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean


def setups() -> dict:
  """{stage: function(config) -> TrainingSetup} of all that can be trained."""
  return registry.setups() | evaluators.SETUPS


# Of a generator's run: the stage whose parameters are frozen in it as its tokenizer.
_HOLDS = {"cmdm.denoiser": "cmdm.tokenizer", "cdamd.generator": "cdamd.autoencoder"}
DTYPES = ("float32", "bfloat16")  # that networks may compute in
# Files of a run folder that are written before the first step, beside those that a stage gives it.
FILES = (checkpoint.CONFIG, checkpoint.DATA, checkpoint.FROZEN, "Mean.npy", "Std.npy")


def run(config, workdir, resume=False, max_seconds=None, stop=None, allow_changes=False,
        profile_steps=None):
  """Trains the stage that config.stage names in the folder workdir. Raises ValueError for a config that cannot run.

  resume: True goes on with the run in the folder; "auto" does if there is one, and starts one if not. allow_changes: a
  run goes on with another config, or other data, than it began with. profile_steps: (first, last) are traced.
  """
  known = setups()
  if config.stage not in known:
    raise ValueError(f"got stage {config.stage!r}, expected one of {', '.join(known)}"
                     f"{did_you_mean(config.stage, known)}")
  metrics.check_tensorboard(config)
  if (dtype := config.train.get("dtype", DTYPES[0])) not in DTYPES:
    raise InputError(f"got train.dtype {dtype!r}, expected {' or '.join(DTYPES)}")
  workdir = pathlib.Path(workdir)
  config, told = resolve(config)
  if config.train.freeze and not config.train.start:
    raise InputError(f"got train.freeze {tuple(config.train.freeze)} without train.start, expected the run whose "
                     "parameters are to stay as they are: random ones are worth no keeping")
  if config.train.freeze and is_schedule_free(config.optimizer):
    raise InputError(f"got train.freeze with optimizer.name {config.optimizer.name!r}, whose average would move what "
                     "is frozen; choose another optimizer, such as adamw")
  if resume == "auto":
    resume = not checkpoint.is_fresh(workdir)
    print(f"--resume=auto: {'going on with' if resume else 'starting'} {workdir}")
  processes = f" of {jax.process_count()} processes" if jax.process_count() > 1 else ""
  print(f"{config.stage} in {workdir} on {jax.device_count()} {jax.default_backend()} device(s){processes}")
  print(*(f"  {line}" for line in config_files.lines_of(config)), sep="\n")
  print(told or "data: being read", flush=True)
  if resume and (workdir / checkpoint.CONFIG).is_file():
    before = runs.load_run(workdir).config
    config = resuming.epochs_as_before(config, before)
    resuming.check_config(config, before, allow_changes)
  setup = validation.with_fid(known[config.stage](config), config)
  config = resuming.resolve_epochs(config, setup.num_items)
  progress.check_profile_steps(profile_steps, config.train.num_steps)
  stage, next_batch, frozen, evaluate, stats, files, num_items = setup
  print(f"training: {resuming.describe_length(config, num_items)}")
  if stage.about_loss:
    print(f"loss: {stage.about_loss}", flush=True)
  draw = pictures.drawer(config, workdir, setup)
  if config.train.start:
    stage = _started_from(stage, config)
  workdir.mkdir(parents=True, exist_ok=True)
  first = distributed.is_first()  # of several processes, this one writes
  with lock.locked(workdir) if first else contextlib.nullcontext():
    goes_on = not checkpoint.is_fresh(workdir)
    if goes_on and not resume:
      raise ValueError(f"{workdir} holds a run already; --resume continues it, or choose another folder")
    if goes_on:
      frozen = resuming.frozen_as_before(workdir, stats, frozen, files)
    files = files | {checkpoint.DATA: resuming.digests(workdir, config, goes_on, allow_changes)}
    distributed.wait_for_all("the folder is read")
    if first:
      atomic.remove_strays(workdir, (*FILES, *files))
      checkpoint.save_config(workdir, config)
      stats_lib.save_stats(stats, workdir)
      if frozen:  # a run folder is all that loading needs
        checkpoint.save_params(workdir, frozen, name=checkpoint.FROZEN)
      for name, text in files.items():
        checkpoint.save_text(workdir, name, text)
    state = loop.train(config, workdir, stage, next_batch, frozen, resume, evaluate, max_seconds, stop,
                        profile_steps, draw)
    distributed.wait_for_all("the run has ended")  # the first one may still be writing
    print(f"wrote {workdir}/params.safetensors, metrics.jsonl, loss.png at step {int(state.step)}")
  return state


def encode(config, folder) -> str:
  """Writes in a folder the store of what a config trains on, for data.store; returns what to tell of it."""
  known = registry.stores()
  if config.stage not in known:
    raise ValueError(f"got stage {config.stage!r}, which trains on no latents that could be kept; expected one of "
                     f"{', '.join(known)}")
  config, told = resolve(config)
  print(told or "data: being read", flush=True)
  return known[config.stage](config, folder)


def resolve(config):
  """(a copy of a config with all that training reads and its run folder records, what to tell of its data).

  Fields that it leaves out get their defaults. A config as it is written leaves open what its folders are and how large
  the frozen parts are that it names: here they are looked at, and nowhere else is a config changed.
  """
  found = config.copy_and_resolve_references().unlock()
  found = runs.with_defaults(found)
  told = sources.recognize(found)
  for name, value in registry.resolved().get(config.stage, lambda config: {})(found).items():
    found[name] = value
  return found.lock(), told


def _started_from(stage, config):
  """The stage with the parameters of another run, a folder or a name that ships, to begin with; what that run does not
  have begins at random. A tokenizer is also found inside a generator's run."""
  folder = config.train.start
  run = runs.load_run(folder)
  inside = run.stage != config.stage and _HOLDS.get(run.stage) == config.stage
  start = flax.traverse_util.flatten_dict(run.frozen()[TOKENIZER] if inside else run.params())
  for name in config.train.freeze:
    if not any(name in path for path in start):
      raise InputError(f"got train.freeze {name!r}, but train.start {folder} has no parameters of that name, only "
                       f"{', '.join(sorted({path[1] for path in start if len(path) > 1}))}")

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
