"""How long a run is, and whether a resumed run is still the same: its config, its data, its frozen parts."""
import json

import jax
import numpy as np

from motion_jax.data import sources
from motion_jax.motion import stats as stats_lib
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError

# Fields that may change when a run resumes: where data and frozen parts lie (their content is compared instead), how
# motion is sampled, how long the run is, how it is logged and guarded, and on what it is computed.
FREE = ("frozen", "origin", "alignment_teacher", "teacher", "text", "paper_row", "sampler", "mesh", "data.folder",
        "data.folders", "data.store", "optimizer.cooldown_steps", "train.num_steps", "train.num_epochs",
        "train.num_saves", "train.log_every", "train.keep_last", "train.max_skips", "train.max_rollbacks",
        "train.hang_minutes", "train.workers", "train.remat", "train.scan_layers", "optimizer.accumulate_steps",
        "train.tensorboard", "train.sample_every")


def check_config(config, before, allow=False, report=print):
  """Raises InputError that names each field in which a config differs from the one that the run began with.

  allow: report them instead. FREE fields may differ.
  """
  changed = [f"{path} was {then!r}, is {now!r}" for path, then, now in changes(before.to_dict(), config.to_dict())]
  if not changed:
    return
  listed = "; ".join(changed[:8]) + (f" and {len(changed) - 8} more" if len(changed) > 8 else "")
  if not allow:
    section = changed[0].partition(" ")[0].partition(".")[0]
    raise InputError(f"--resume with another {section}: {listed}; give what the run began with, --allow-changes to "
                     "continue with other settings, or a new folder")
  report(f"note: the run continues with other settings: {listed}")


def changes(before, now, path=""):
  """Yields (path, then, now) of the fields of two configs, as dicts, that differ and are not FREE."""
  for key in sorted(before.keys() | now.keys()):
    name = f"{path}.{key}" if path else key
    then, value = (_plain(side.get(key)) for side in (before, now))
    if name in FREE or then == value:
      continue
    if isinstance(then, dict) and isinstance(value, dict):
      yield from changes(then, value, name)
    else:
      yield name, then, value


def _plain(value):
  """Tuples as the lists that JSON makes of them."""
  return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def digests(workdir, config, resumes, allow=False, report=print) -> str:
  """Digests of the folders of config.data, as JSON. Raises InputError if a run that resumes began with other bytes.

  allow: report it instead.
  """
  now = json.dumps({"digests": sources.digests(config.data)}) + "\n"
  if not resumes:
    return now
  if checkpoint.load_json(workdir, checkpoint.DATA) != json.loads(now):
    note = (f"the files in {config.data.get('folders') or config.data.get('folder')} are not those that {workdir} "
            "began with")
    if not allow:
      raise InputError(f"--resume with other data: {note}; give those, --allow-changes to continue with these, or a "
                       "new folder")
    report(f"note: {note}")
  return now


def frozen_as_before(workdir, stats, frozen, files):
  """The frozen parts of a resumed run, from its own folder. Raises InputError if the statistics of the data, the
  tokenizer or the text encoder are not those that it began with."""
  before = stats_lib.load_stats(workdir, stats.layout)
  if (np.abs(before.mean - stats.mean) > 0.01 * before.std).any() or not np.allclose(before.std, stats.std, rtol=0.01):
    raise InputError(f"--resume with other data: the statistics in {workdir} are not those of the data or the "
                     "tokenizer given now; give those that the run began with, or start a new folder")
  known = checkpoint.load_fingerprint(workdir)
  if known is not None and known != json.loads(files[checkpoint.TEXT])["fingerprint"]:
    raise InputError(f"--resume with another text encoder than {workdir} began with; start a new folder instead")
  if not frozen:
    return frozen
  own = checkpoint.load_params(workdir, frozen, name=checkpoint.FROZEN)
  for part in ("tokenizer", "teacher", "teacher_view"):
    same = jax.tree.map(lambda a, b: np.allclose(a, b, rtol=1e-5, atol=1e-6), own.get(part), frozen.get(part))
    if not all(jax.tree.leaves(same)):
      raise InputError(f"--resume with another {part} than {workdir} began with; its features mean something else, "
                       "start a new folder instead")
  return own


# --- the length of a run: config.train counts it in epochs or steps; data must be read to know the steps --------------


def resolve_epochs(config, num_items):
  """The config with its length in steps, for training data of num_items windows or captioned clips.

  Where train.num_steps is 0, it becomes train.num_epochs times the number of whole batches in an epoch, and a
  train.save_every of 0 becomes one train.num_saves-th of that. Values above 0 stay.
  """
  train = config.train
  if train.num_steps:
    return config
  epochs = train.get("num_epochs", 0)
  if epochs <= 0 or not num_items:
    raise InputError(f"got train.num_steps 0 and train.num_epochs {epochs}, expected one of them above 0")
  found = config.copy_and_resolve_references().unlock()
  found.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)
  found.train.save_every = train.save_every or max(found.train.num_steps // max(train.num_saves, 1), 1)
  found.train.sample_every = min(train.sample_every, found.train.num_steps)
  return found.lock()


def epochs_as_before(config, before):
  """The config of a resumed run with the length that its folder records, where the config leaves it open.

  With another number of epochs the run becomes longer or shorter; it is saved as often as before.
  """
  if config.train.num_steps:
    return config
  found = config.copy_and_resolve_references().unlock()
  found.train.save_every = config.train.save_every or before.train.save_every
  if config.train.get("num_epochs", 0) == before.train.get("num_epochs", 0):
    found.train.update(num_steps=before.train.num_steps, sample_every=before.train.sample_every)
  return found.lock()


def describe_length(config, num_items) -> str:
  """The length of a run in one line."""
  train, batch = config.train, config.data.batch_size
  epochs = train.num_steps / max(num_items // batch, 1)
  return (f"{train.num_steps:,} steps of {batch} items" + (
      f", {epochs:.3g} epochs of {num_items:,}" if num_items else "") + f"; saves every {train.save_every:,} steps")
