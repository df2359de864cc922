"""What the loop needs to train a stage, made from a config: the stage, its batches, its frozen parts."""
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

_CARRIED = 16 << 20  # bytes of a text encoder up to which a run folder carries a copy


class TrainingSetup(NamedTuple):
  """A stage with all that it is trained on.

  next_batch(step, rows=ALL) -> dict of arrays, the rows of a batch or a slice of them; frozen: arrays that the loss
  reads and nobody changes; evaluate(params) -> dict of numbers, or None; stats of the features; files: {name: text or
  bytes} that the run folder keeps; num_items: the windows or captioned clips of an epoch (`epochs`).
  """
  stage: Stage
  next_batch: Callable
  frozen: Any
  evaluate: Callable | None
  stats: Stats
  files: dict[str, str | bytes]
  num_items: int = 0


def untrained(shapes, seed=0):
  """Random parameters of these shapes, for trying things out: products keep their size, nothing is compiled."""
  draw = np.random.default_rng(seed)

  def fill(path, leaf):
    name = path[-1].key
    if len(leaf.shape) < 2:
      return np.full(leaf.shape, float(name == "scale"), np.float32)
    fan_in = max(int(np.prod(leaf.shape[:-1])), 1)
    return draw.standard_normal(leaf.shape, np.float32) / np.sqrt(np.float32(fan_in))

  return jax.tree_util.tree_map_with_path(fill, shapes)


def held_stats(config):
  """Of a stage that is trained in part (config.train.freeze): the statistics of the run that it starts from, which its
  frozen parameters know; else None, and the data have their own."""
  return runs.load_run(config.train.start).stats if config.train.freeze else None


def held_out(config, stats, captioned=False):
  """The validation split, or a few of the training clips where there is none (synthetic data)."""
  try:
    return sources.load_features(config.data, "val", stats, captioned)
  except ValueError:
    data = sources.load_features(config.data, "train", stats, captioned)
    return dataclasses.replace(data, features=data.features[:8], captions=data.captions[:8])


def reconstruction_error(reconstruct, features, stats, length=192):
  """Mean distance in millimetres of joints before and after reconstruct(x (1, length, F)), both root-aligned.

  Heading and path are those that the features sum up to (docs/papers/cmdm.md#reconstruction, "with heading"). Clips are
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
  """JSON by which loading knows that captions are encoded as they were in training.

  Of a folder of one's own its name is told, not where it lay.
  """
  name = encoder.folder.name if encoder.folder else encoder.name
  return json.dumps({"name": name, "fingerprint": encoder.fingerprint}) + "\n"


def encoder_files(encoder):
  """{name: content} of what a run folder keeps of its text encoder: who it is, and all of it where it lay in a folder
  of one's own and is small, so that the run opens on another machine, too."""
  files = {checkpoint.TEXT: text_identity(encoder)}
  own = {f"{checkpoint.ENCODER}/{path.relative_to(encoder.folder).as_posix()}": path for path in encoder.files()}
  if sum(path.stat().st_size for path in own.values()) <= _CARRIED:
    files |= {name: path.read_bytes() for name, path in own.items()}
  return files


def caption_lengths(data):
  """JSON rows [caption, median frames], by which a prompt without a length gets that of its like."""
  frames = {}
  for x, captions in zip(data.features, data.captions):
    for caption in captions:
      frames.setdefault(caption, []).append(len(x))
  return json.dumps([[caption, int(np.median(counts))] for caption, counts in sorted(frames.items())], indent=0)


def one_clip_per_caption(data, max_frames):
  """Of a FeatureSet one clip for each first caption."""
  first = {captions[0]: i for i, captions in reversed(list(enumerate(data.captions))) if captions}
  chosen = sorted(first.values())
  return batches.CaptionedClips([data.features[i] for i in chosen], [data.captions[i][:1] for i in chosen],
                                max_frames)
