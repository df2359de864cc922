"""From a config's data section to clips as features: whatever the source, training sees one thing."""
import dataclasses

import numpy as np
from tqdm import tqdm

from motion_jax.data import archive, humanml3d, mirror, synthetic
from motion_jax.motion.features import FeatureLayout, get_layout, to_features
from motion_jax.motion.stats import Stats, compute_stats


@dataclasses.dataclass(frozen=True, eq=False)
class FeatureSet:
  """Clips of one split as normalized features (T_i, F), with their captions and a group (an action) each."""
  features: list[np.ndarray]
  captions: list[list[str]]
  groups: list[str]
  ids: list[str]
  stats: Stats
  layout: FeatureLayout


def load_clips(config):
  """The clips that a data section names: "synthetic" (seed, num_clips) or "archive" (folders)."""
  if config.name == "synthetic":
    return synthetic.synthetic_clips(config.get("seed", 0), config.get("num_clips", 16))
  if config.name == "archive":
    if not config.folders:
      raise ValueError("data.folders is empty; give the archives, as in "
                       "--config.data.folders='(\"path/to/cmu\",\"path/to/bandai\")'")
    return [clip for folder in config.folders for clip in archive.read_archive(folder)]
  raise ValueError(f"got data.name {config.name!r}, expected synthetic, archive or humanml3d")


def load_features(config, split="train", stats=None, captioned=True) -> FeatureSet:
  """Features of a split of config.data, normalized by stats or, without, by the split's own.

  Archives and synthetic clips become features here (config.mode), mirrored too if config.mirror; HumanML3D folders hold
  them already; there sub-clips with time tags are items of their own, and lengths are limited, unless captioned is
  False: the autoencoders see every whole clip once (facts: cmdm 1.3).
  """
  layout = get_layout(config.layout)
  if config.name == "humanml3d":
    items = humanml3d.text_items(config.folder, split, layout=layout, whole=not captioned)
    features, captions = [item.features for item in items], [list(item.captions) for item in items]
    groups, ids = [item.id for item in items], [item.id for item in items]
    if stats is None:
      stats = humanml3d.folder_stats(config.folder, layout)
  else:
    clips = [clip for clip in load_clips(config) if clip.split == split]
    if not clips:
      raise ValueError(f"data.name {config.name!r} has no clips in split {split!r}")
    if config.get("mirror", False) and split == "train":
      clips += [mirror.mirror_clip(clip) for clip in clips]
    features, captions, groups, ids = [], [], [], []
    for clip in tqdm(clips, desc=f"features of {split}", unit="clip", leave=False):
      if clip.num_frames < 8:
        continue
      features.append(to_features(clip.joints, layout, config.mode))
      captions.append([caption.text for caption in clip.captions])
      groups.append(str(clip.meta.get("content") or clip.meta.get("label") or clip.id))
      ids.append(clip.id)
    if stats is None:
      stats = compute_stats(features, layout)
  return FeatureSet([stats.normalize(x) for x in features], captions, groups, ids, stats, layout)
