"""From a config to a trained run folder: a training set-up, the loop and the folder. What `motion-jax train` calls."""
import json
import pathlib

import flax
import jax
import numpy as np

from motion_jax import runs
from motion_jax.data import sources
from motion_jax.evaluators import setup as evaluators
from motion_jax.inputs.nearest import did_you_mean
from motion_jax.models import registry
from motion_jax.motion import stats as stats_lib
from motion_jax.runtime import lock
from motion_jax.training import checkpoint
from motion_jax.training import loop as train
from motion_jax.training.setup import plain


def setups() -> dict:
  """{stage: function(config) -> TrainingSetup} of all that can be trained."""
  return registry.setups() | evaluators.SETUPS


def run(config, workdir, resume=False, max_seconds=None, stop=None):
  """Trains the stage that config.stage names in the folder workdir. Raises ValueError for a config that cannot run."""
  known = setups()
  if config.stage not in known:
    raise ValueError(f"got stage {config.stage!r}, expected one of {', '.join(known)}"
                     f"{did_you_mean(config.stage, known)}")
  workdir = pathlib.Path(workdir)
  config, told = resolve(config)
  print(f"{config.stage} in {workdir} on {jax.local_device_count()} {jax.default_backend()} device(s)\n{config}")
  print(told or "data: being read", flush=True)
  if resume and (workdir / checkpoint.CONFIG).is_file():
    _check_same_run(config, runs.open(workdir).config)
  stage, next_batch, frozen, evaluate, stats, files = known[config.stage](config)
  if config.train.start:
    stage = _started_from(stage, config.train.start)
  workdir.mkdir(parents=True, exist_ok=True)
  with lock.locked(workdir):
    if not resume and not checkpoint.is_fresh(workdir):
      raise ValueError(f"{workdir} holds a run already; --resume continues it, or choose another folder")
    if resume and not checkpoint.is_fresh(workdir):
      frozen = _as_before(workdir, stats, frozen, files)
    checkpoint.save_config(workdir, config)
    stats_lib.save_stats(stats, workdir)
    if frozen:  # a run folder is all that loading needs
      checkpoint.save_params(workdir, frozen, name=checkpoint.FROZEN)
    for name, text in files.items():
      checkpoint.save_text(workdir, name, text)
    state = train.train(config, workdir, stage, next_batch, frozen, resume, evaluate, max_seconds, stop)
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

  First it is brought up to date, for a file of one's own may be older than some fields. A config as it is written
  leaves open what its folders are and how large the frozen parts are that it names: here they are looked at, and
  nowhere else is a config changed.
  """
  found = runs.upgrade(config).copy_and_resolve_references().unlock()
  told = sources.recognize(found)
  for name, value in registry.resolved().get(config.stage, lambda config: {})(found).items():
    found[name] = value
  return found.lock(), told


def _started_from(stage, folder):
  """The stage with the parameters of another run to begin with; what that run does not have begins fresh."""
  start = flax.traverse_util.flatten_dict(checkpoint.load_params(folder))

  def init(batch, rng):
    fresh = flax.traverse_util.flatten_dict(stage.init(batch, rng))
    shared = {path: fresh[path] for path in fresh.keys() & start.keys()}
    unused = start.keys() - fresh.keys()
    if unused:
      raise ValueError(f"train.start {folder} has parameters that this config lacks, such as "
                       f"{'/'.join(sorted(unused)[0])}; make the models agree")
    checkpoint.check_fits(flax.traverse_util.unflatten_dict(start), flax.traverse_util.unflatten_dict(shared),
                          f"train.start {folder} does not fit this config")
    return flax.traverse_util.unflatten_dict({**fresh, **start})

  return stage._replace(init=init)


def _check_same_run(config, before):
  for part in ("stage", "seed", "model", "quantizer", "loss", "data", "optimizer"):
    now, then = config.get(part), before.get(part)
    now, then = (c.to_dict() if hasattr(c, "to_dict") else c for c in (now, then))
    if plain(now) != plain(then):
      raise ValueError(f"--resume with another {part}: the run has {then}, got {now}; start a new folder instead")


def _as_before(workdir, stats, frozen, files):
  """What a resumed run stands on, from its own folder; raises ValueError if data, tokenizer or words are others now."""
  before = stats_lib.load_stats(workdir, stats.layout)
  if (np.abs(before.mean - stats.mean) > 0.01 * before.std).any() or not np.allclose(before.std, stats.std, rtol=0.01):
    raise ValueError(f"--resume with other data: the statistics in {workdir} are not those of the data or the "
                     "tokenizer given now; give those that the run began with, or start a new folder")
  known = checkpoint.load_fingerprint(workdir)
  if known is not None and known != json.loads(files[checkpoint.TEXT])["fingerprint"]:
    raise ValueError(f"--resume with another text encoder than {workdir} began with; start a new folder instead")
  if not frozen:
    return frozen
  own = checkpoint.load_params(workdir, frozen, name=checkpoint.FROZEN)
  for part in ("tokenizer", "teacher", "teacher_view"):
    same = jax.tree.map(lambda a, b: np.allclose(a, b, rtol=1e-5, atol=1e-6), own.get(part), frozen.get(part))
    if not all(jax.tree.leaves(same)):
      raise ValueError(f"--resume with another {part} than {workdir} began with; its features mean something else, "
                       "start a new folder instead")
  return own
