"""From a config's data section to clips as features: whatever the source, training sees one thing.

  data.name     data.folder (or folders)        layouts                          more
  humanml3d     HumanML3D's or KIT-ML's         full, essential, coordinates     KIT: full_kit, essential_kit, ...
  snapmogen     SnapMoGen's                     snapmogen, snapmogen_148
  babel         BABEL's, FlowMDM's form         babel                            kind: pairs, segments, both
  archive       folders of `data.archive`       any                              mode, mirror
  synthetic     none                            any                              mode, mirror, num_clips
"""
import dataclasses

import numpy as np
from tqdm import tqdm

from motion_jax.data import archive, babel, humanml3d, mirror, snapmogen, synthetic
from motion_jax.motion.features import FeatureLayout, get_layout, to_features
from motion_jax.motion.stats import Stats, compute_stats


@dataclasses.dataclass(frozen=True, eq=False)
class FeatureSet:
  """Clips of one split as normalized features (T_i, F), with their captions and a group (an action) each.

  tokens: {caption: its tokens "lemma/POS"} where the data set's files hold them.
  """
  features: list[np.ndarray]
  captions: list[list[str]]
  groups: list[str]
  ids: list[str]
  stats: Stats
  layout: FeatureLayout
  tokens: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)


def load_clips(config):
  """The clips that a data section names: "synthetic" (seed, num_clips) or "archive" (folders)."""
  if config.name == "synthetic":
    return synthetic.synthetic_clips(config.get("seed", 0), config.get("num_clips", 16))
  if config.name == "archive":
    if not config.folders:
      raise ValueError("data.folders is empty; give the archives, as in "
                       "--config.data.folders='(\"path/to/cmu\",\"path/to/bandai\")'")
    return [clip for folder in config.folders for clip in archive.read_archive(folder)]
  raise ValueError(f"got data.name {config.name!r}, expected synthetic, archive, {', '.join(_FOLDERS)}")


def _humanml3d(config, split, layout, captioned):
  items = humanml3d.text_items(config.folder, split, layout=layout, whole=not captioned)
  return items, lambda: humanml3d.folder_stats(config.folder, layout, config.get("per_axis", False))


def _snapmogen(config, split, layout, captioned):
  items = snapmogen.text_items(config.folder, split, layout, whole=not captioned)
  return items, lambda: snapmogen.folder_stats(config.folder, layout)


def _babel(config, split, layout, captioned):
  if layout.name != "babel":
    raise ValueError(f"BABEL's motions become 'babel' features, asked for {layout.name!r}")
  items = babel.pieces(config.folder, split, config.get("kind", "pairs"), whole=not captioned, mode=config.mode)
  return items, lambda: babel.folder_stats(config.folder, config.mode)


# (config, split, layout, captioned) -> (items with id, features and captions, function that gives the statistics).
_FOLDERS = {"humanml3d": _humanml3d, "snapmogen": _snapmogen, "babel": _babel}


def load_features(config, split="train", stats=None, captioned=True) -> FeatureSet:
  """Features of a split of config.data, normalized by stats or, without, by the split's own.

  Archives and synthetic clips become features here (config.mode), on the layout's skeleton and at its rate, mirrored
  too if config.mirror. Folders of data sets hold them already, or say how they are cut: there each captioned part is an
  item of its own, and lengths are limited, unless captioned is False: the autoencoders see every whole clip once
  (facts: cmdm 1.3).
  """
  layout, tokens = get_layout(config.layout), {}
  if config.name in _FOLDERS:
    if not config.folder:
      raise ValueError(f"data.folder is empty; give the folder of {config.name!r}, as in "
                       "--config.data.folder=path/to/folder")
    items, own_stats = _FOLDERS[config.name](config, split, layout, captioned)
    features, captions = [item.features for item in items], [list(item.captions) for item in items]
    groups, ids = [item.id for item in items], [item.id for item in items]
    for item in items:
      tokens |= {c: words for c, words in zip(item.captions, getattr(item, "tokens", ())) if words}
    stats = own_stats() if stats is None else stats
    if not items:
      raise ValueError(f"{config.folder} has no clips for {config.name!r} in split {split!r}")
  else:
    clips = [clip for clip in load_clips(config) if clip.split == split]
    if not clips:
      raise ValueError(f"data.name {config.name!r} has no clips in split {split!r}")
    if config.get("mirror", False) and split == "train":
      clips += [mirror.mirror_clip(clip) for clip in clips]
    features, captions, groups, ids = [], [], [], []
    for clip in tqdm(clips, desc=f"features of {split}", unit="clip", leave=False, disable=None):
      if clip.num_frames < 8:
        continue
      if clip.skeleton is not layout.skeleton:
        clip = synthetic.on_skeleton(clip, layout.skeleton)
      features.append(to_features(clip.joints, layout, config.mode))
      captions.append([caption.text for caption in clip.captions])
      groups.append(str(clip.meta.get("content") or clip.meta.get("label") or clip.id))
      ids.append(clip.id)
    if stats is None:
      stats = compute_stats(features, layout, config.get("per_axis", False))
  return FeatureSet([stats.normalize(x) for x in features], captions, groups, ids, stats, layout,
                    tokens)
