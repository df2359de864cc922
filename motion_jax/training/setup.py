"""The training set-up of a config: a stage with its batches and frozen parts, and the length of the run.

A run that resumes must have the config, the data and the frozen parts that it began with: `check_config`, `digests` and
`frozen_as_before` compare them.
"""
import dataclasses
import json
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from motion_jax.data import batches, sources
from motion_jax.motion.representations import to_joints
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.training import checkpoint
from motion_jax.training.stage import Stage
from motion_jax.utils.errors import InputError

_CARRIED = 16 << 20  # a run folder carries a copy of a text encoder up to this number of bytes


class TrainingSetup(NamedTuple):
  """A stage with everything that it is trained on.

  next_batch(step, rows=ALL) -> dict of arrays, the rows of a batch or a slice of them; frozen: arrays that the loss
  reads and training does not change; evaluate(params) -> dict of numbers, or None; stats of the features; files: {name:
  text or bytes} to keep in the run folder; num_items: number of windows or captioned clips in an epoch.
  """
  stage: Stage
  next_batch: Callable
  frozen: Any
  evaluate: Callable | None
  stats: Stats
  files: dict[str, str | bytes]
  num_items: int = 0


def demand_same_network(what: str, theirs: Any, ours: Any, section: str = "config.tokenizer", **unlike: Any) -> None:
  """Raises InputError where a trained network, `what`, is not the module that this config describes; its fields that
  differ are named. unlike: fields that play no part, with a value for both."""
  theirs, ours = theirs.clone(**unlike), ours.clone(**unlike)
  if theirs == ours:
    return
  names = [field.name for field in dataclasses.fields(ours) if field.name not in ("parent", "name")]
  differ = [name for name in names if getattr(theirs, name) != getattr(ours, name)]
  said = lambda module: ", ".join(f"{name} {getattr(module, name)}" for name in differ)
  raise InputError(f"{what} has {said(theirs)}, {section} says {said(ours)}; make them agree")


def untrained(shapes, seed=0):
  """Random parameters of these shapes, drawn by numpy without compiling anything; products keep their size."""
  draw = np.random.default_rng(seed)

  def fill(path, leaf):
    name = path[-1].key
    if len(leaf.shape) < 2:
      return np.full(leaf.shape, float(name == "scale"), np.float32)
    fan_in = max(int(np.prod(leaf.shape[:-1])), 1)
    return draw.standard_normal(leaf.shape, np.float32) / np.sqrt(np.float32(fan_in))

  return jax.tree_util.tree_map_with_path(fill, shapes)


def held_out(config, stats, captioned=False):
  """The validation split, or a few training clips where the data have none (synthetic data)."""
  try:
    return sources.load_features(config.data, "val", stats, captioned)
  except ValueError:
    data = sources.load_features(config.data, "train", stats, captioned)
    return dataclasses.replace(data, features=data.features[:8], captions=data.captions[:8])


def reconstruction_error(reconstruct, features, stats, length=192):
  """Mean distance in millimetres of joints before and after reconstruct(x (1, length, F)), both root-aligned.

  Heading and path are integrated from the features (docs/papers/cmdm.md#reconstruction, "with heading"). Clips are
  padded to one length, so that one compiled function serves all.
  """
  total = count = 0
  for clip in features:
    clip = clip[:min(len(clip), length) // 4 * 4]
    padded = np.zeros((1, length, clip.shape[-1]), np.float32)
    padded[0, :len(clip)] = clip
    joints = [to_joints(stats.denormalize(np.asarray(x)), stats.layout)
              for x in (clip, reconstruct(padded)[0, :len(clip)])]
    real, decoded = (j - j[:, :1] for j in joints)
    total += np.linalg.norm(real - decoded, axis=-1).mean(-1).sum() * stats.layout.skeleton.unit * 1000
    count += len(clip)
  return float(total / count)


def text_identity(encoder):
  """JSON that identifies a text encoder, so that loading can check that captions are encoded as in training.

  For a folder it holds the name, not the location.
  """
  name = encoder.folder.name if encoder.folder else encoder.name
  return json.dumps({"name": name, "fingerprint": encoder.fingerprint}) + "\n"


def encoder_files(encoder):
  """{name: content} of what a run folder keeps of its text encoder: its identity, and a copy of a small encoder from a
  folder, so that the run also opens on another machine."""
  files = {checkpoint.TEXT: text_identity(encoder)}
  carried = {f"{checkpoint.ENCODER}/{path.relative_to(encoder.folder).as_posix()}": path for path in encoder.files()}
  if sum(path.stat().st_size for path in carried.values()) <= _CARRIED:
    files |= {name: path.read_bytes() for name, path in carried.items()}
  return files


def caption_lengths(data, left_out=()):
  """JSON rows [caption, median frames], one a line, from which a prompt without a length gets that of similar captions.

  Without paraphrases: a prompt that is a training caption is one action, and most paraphrases are ways to say several.
  """
  frames = {}
  for x, captions in zip(data.features, data.own_captions):
    for caption in captions:
      if caption not in left_out:
        frames.setdefault(caption, []).append(len(x))
  rows = (json.dumps([caption, int(np.median(counts))]) for caption, counts in sorted(frames.items()))
  return "[\n" + ",\n".join(rows) + "\n]\n"


def one_clip_per_caption(data, max_frames):
  """One clip of a FeatureSet for each first caption."""
  first = {captions[0]: i for i, captions in reversed(list(enumerate(data.captions))) if captions}
  chosen = sorted(first.values())
  return batches.CaptionedClips([data.features[i] for i in chosen], [data.captions[i][:1] for i in chosen],
                                max_frames)


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
  resolved = config.copy_and_resolve_references().unlock()
  resolved.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)
  resolved.train.save_every = train.save_every or max(resolved.train.num_steps // max(train.num_saves, 1), 1)
  resolved.train.sample_every = min(train.sample_every, resolved.train.num_steps)
  return resolved.lock()


def epochs_as_before(config, before):
  """The config of a resumed run with the length that its folder records, where the config leaves it open.

  With another number of epochs the run becomes longer or shorter; it is saved as often as before.
  """
  if config.train.num_steps:
    return config
  resolved = config.copy_and_resolve_references().unlock()
  resolved.train.save_every = config.train.save_every or before.train.save_every
  if config.train.get("num_epochs", 0) == before.train.get("num_epochs", 0):
    resolved.train.update(num_steps=before.train.num_steps, sample_every=before.train.sample_every)
  return resolved.lock()


def describe_length(config, num_items) -> str:
  """The length of a run in one line."""
  train, batch = config.train, config.data.batch_size
  epochs = train.num_steps / max(num_items // batch, 1)
  return (f"{train.num_steps:,} steps of {batch} items" + (
      f", {epochs:.3g} epochs of {num_items:,}" if num_items else "") + f"; saves every {train.save_every:,} steps")


# --- whether a resumed run is still the same: its config, its data, its frozen parts ----------------------------------

# Fields that may change when a run resumes: where data and frozen parts lie (their content is compared instead), how
# motion is sampled, how long the run is, how it is logged and guarded, and on what it is computed.
FREE = ("frozen", "origin", "alignment_teacher", "teacher", "text", "paper_row", "sampler", "cleanup", "mesh",
        "data.folder", "data.folders", "data.store", "data.workers", "optimizer.cooldown_steps", "train.num_steps",
        "train.num_epochs", "train.num_saves", "train.cpu_seconds", "train.seconds", "train.log_every",
        "train.keep_last", "train.max_skips", "train.max_rollbacks", "train.hang_minutes", "train.workers",
        "train.remat", "train.attention", "train.scan_layers", "optimizer.accumulate_steps", "train.tensorboard",
        "train.sample_every")


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
  """Yields (path, then, now) of the fields of two configs, as dicts, that differ and are not FREE.

  A field that only one of them has is no change where it is off, as 0 and "" are: a run can be resumed by a version
  that has more fields than the one that it began with.
  """
  for key in sorted(before.keys() | now.keys()):
    name = f"{path}.{key}" if path else key
    then, value = (_plain(side.get(key)) for side in (before, now))
    if name in FREE or then == value or not then and not value and None in (then, value):
      continue
    if all(isinstance(part, dict | None) for part in (then, value)):
      yield from changes(then or {}, value or {}, name)
    else:
      yield name, then, value


def _plain(value):
  """Tuples as the lists that JSON makes of them."""
  return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


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
  before = load_stats(workdir, stats.layout)
  if (np.abs(before.mean - stats.mean) > 0.01 * before.std).any() or not np.allclose(before.std, stats.std, rtol=0.01):
    raise InputError(f"--resume with other data: the statistics in {workdir} are not those of the data or the "
                     "tokenizer given now; give those that the run began with, or start a new folder")
  known = checkpoint.load_fingerprint(workdir)
  if known is not None and known != json.loads(files[checkpoint.TEXT])["fingerprint"]:
    raise InputError(f"--resume with another text encoder than {workdir} began with; start a new folder instead")
  if not frozen:
    return frozen
  saved = checkpoint.load_params(workdir, frozen, name=checkpoint.FROZEN)
  for part in ("tokenizer", "teacher", "teacher_view"):
    same = jax.tree.map(lambda a, b: np.allclose(a, b, rtol=1e-5, atol=1e-6), saved.get(part), frozen.get(part))
    if not all(jax.tree.leaves(same)):
      raise InputError(f"--resume with another {part} than {workdir} began with; its features mean something else, "
                       "start a new folder instead")
  return saved
