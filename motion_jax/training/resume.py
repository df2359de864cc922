"""Whether a run that goes on is still the run that it was: its config, its data, what it was trained on top of."""
import json
import pathlib

import jax
import numpy as np

from motion_jax.data import sources
from motion_jax.motion import stats as stats_lib
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError

# What of a config may be another when a run goes on: where things lie and what they came from (their content is
# compared instead), how motion is sampled, how long the run lasts and is looked after, on what it is computed.
FREE = ("frozen", "origin", "taught_by", "teacher", "text", "paper_row", "sampler", "mesh", "data.folder",
        "data.folders", "data.store", "optimizer.cooldown_steps", "train.num_steps", "train.num_epochs",
        "train.num_saves", "train.log_every", "train.keep_last", "train.max_skips", "train.max_rollbacks",
        "train.hang_minutes", "train.workers", "train.remat", "train.scan_layers", "optimizer.accumulate_steps",
        "train.tensorboard", "train.sample_every")


def check_config(config, before, allow=False, tell=print):
  """Raises InputError where a config differs from the one that the run began with, which it names field by field.

  allow: tell it, and go on with the given one. FREE fields may differ.
  """
  changed = [f"{path} was {then!r}, is {now!r}" for path, then, now in changes(before.to_dict(), config.to_dict())]
  if not changed:
    return
  told = "; ".join(changed[:8]) + (f" and {len(changed) - 8} more" if len(changed) > 8 else "")
  if not allow:
    section = changed[0].partition(" ")[0].partition(".")[0]
    raise InputError(f"--resume with another {section}: {told}; give what the run began with, --allow-changes to go on "
                     "with other settings, or a new folder")
  tell(f"note: the run goes on with other settings: {told}")


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


def digests(workdir, config, goes_on, allow=False, tell=print) -> str:
  """Digests of the folders of config.data, as JSON. Raises InputError if a run that goes on began with other bytes.

  allow: tell it, and go on.
  """
  now = json.dumps({"digests": sources.digests(config.data)}) + "\n"
  if not goes_on or not (pathlib.Path(workdir) / checkpoint.DATA).is_file():  # a run of an older version has none
    return now
  if checkpoint.load_json(workdir, checkpoint.DATA) != json.loads(now):
    told = (f"the files in {config.data.get('folders') or config.data.get('folder')} are not those that {workdir} "
            "began with")
    if not allow:
      raise InputError(f"--resume with other data: {told}; give those, --allow-changes to go on with these, or a new "
                       "folder")
    tell(f"note: {told}")
  return now


def as_before(workdir, stats, frozen, files):
  """What a resumed run stands on, from its own folder; raises InputError if data, tokenizer or words are others now."""
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
