"""The training set-up of a config: a stage, its batches, its frozen parts, and what set-ups share."""
import dataclasses
import json
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from motion_jax import runs
from motion_jax.data import batches, sources
from motion_jax.motion.representations import to_joints
from motion_jax.motion.stats import Stats
from motion_jax.training import checkpoint
from motion_jax.training.stage import Stage

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


def held_stats(config):
  """The statistics of the run that a partly frozen stage (config.train.freeze) starts from, to which its parameters
  belong; None for other stages, whose statistics come from their data."""
  return runs.load_run(config.train.start).stats if config.train.freeze else None


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
    real, made = (j - j[:, :1] for j in joints)
    total += np.linalg.norm(real - made, axis=-1).mean(-1).sum() * stats.layout.skeleton.unit * 1000
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
  own = {f"{checkpoint.ENCODER}/{path.relative_to(encoder.folder).as_posix()}": path for path in encoder.files()}
  if sum(path.stat().st_size for path in own.values()) <= _CARRIED:
    files |= {name: path.read_bytes() for name, path in own.items()}
  return files


def caption_lengths(data):
  """JSON rows [caption, median frames], from which a prompt without a length gets that of similar captions."""
  frames = {}
  for x, captions in zip(data.features, data.captions):
    for caption in captions:
      frames.setdefault(caption, []).append(len(x))
  return json.dumps([[caption, int(np.median(counts))] for caption, counts in sorted(frames.items())], indent=0)


def one_clip_per_caption(data, max_frames):
  """One clip of a FeatureSet for each first caption."""
  first = {captions[0]: i for i, captions in reversed(list(enumerate(data.captions))) if captions}
  chosen = sorted(first.values())
  return batches.CaptionedClips([data.features[i] for i in chosen], [data.captions[i][:1] for i in chosen],
                                max_frames)
