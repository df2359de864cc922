"""From a config's data section to clips as features: whatever the source, training sees one thing.

  data.name     data.folder (or folders)        layouts                          more
  humanml3d     HumanML3D's or KIT-ML's         full, essential, coordinates     KIT: full_kit, essential_kit, ...
  snapmogen     SnapMoGen's                     snapmogen, snapmogen_148
  babel         BABEL's, FlowMDM's form         babel                            kind: pairs, segments, both
  archive       folders of `data.datasets.archive`       any                              mode, mirror
  synthetic     none                            any                              mode, mirror, num_clips

A folder is looked at before it is read (`recognize`): one that `motion-jax data build` made works with a config for
archives, and the other way round.
"""
import dataclasses
import pathlib

import numpy as np
from tqdm import tqdm

from motion_jax.data import mirror
from motion_jax.data.datasets import archive, babel, humanml3d, snapmogen, synthetic
from motion_jax.inputs.errors import InputError
from motion_jax.motion.representations import FeatureLayout, get_layout, to_features
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


def kind_of(folder) -> str:
  """What lies in a data folder: "archive", "humanml3d", "snapmogen" or "babel". Raises FileNotFoundError for none."""
  folder = pathlib.Path(folder)
  known = {"archive": archive.is_archive(folder), "humanml3d": (folder / "new_joint_vecs").is_dir(),
           "snapmogen": snapmogen.is_snapmogen(folder), "babel": babel.is_babel(folder)}
  found = [name for name, is_one in known.items() if is_one]
  if found:
    return found[0]
  if not folder.is_dir():
    raise FileNotFoundError(f"there is no folder {folder}; give a data folder, such as one that `motion-jax data "
                            "build` made")
  from motion_jax.data.build import READERS
  files = [path for path in folder.rglob("*") if path.suffix.lower() in READERS]
  raise FileNotFoundError(
      f"{folder} holds {len(files)} files of motion capture; make a data folder of them first: motion-jax data build "
      f"{folder} data/mine" if files else
      f"{folder} is no data folder: expected an archive (motions.npz, captions.jsonl), HumanML3D's or KIT-ML's "
      "(new_joint_vecs, texts), SnapMoGen's (renamed_feats) or BABEL's (motions, val.json)")


def recognize(config):
  """Puts into a config's data section what its folders are, and returns what to tell of that, or "".

  config: a copy that is not locked, as `fit.resolve` makes it: nobody's own config is changed.
  data.name and data.folder or data.folders are made to agree with what lies there: "humanml3d" for one folder in that
  layout, with data.mode as its features are, "archive" for archives and for several folders. Folders that do not exist
  are left for the reader to name; other kinds of data are what they are said to be.
  """
  data = config.data
  if data.name not in ("archive", "humanml3d"):
    return ""
  folders = tuple(data.get("folders", ())) or ((data.folder,) if data.get("folder") else ())
  if not folders:
    return ""
  if data.get("folder") and data.get("folders"):
    raise InputError(f"got data.folder {data.folder!r} and data.folders {tuple(data.folders)}; give one of them")
  kinds = [kind_of(folder) for folder in folders]
  strange = [(folder, kind) for folder, kind in zip(folders, kinds) if kind not in ("archive", "humanml3d")]
  if strange:
    raise InputError("{} is {} data; its own size of the config reads it, as in "
                     "--config cmdm_denoiser:snapmogen".format(*strange[0]))
  if kinds != ["humanml3d"]:
    data.update(name="archive", folder="", folders=folders)
    return "" if set(kinds) == {"archive"} else f"data: {len(folders)} folders, read clip by clip"
  data.update(name="humanml3d", folder=str(folders[0]), folders=())
  info = humanml3d.dataset_info(folders[0])
  told = f"data: {folders[0]}, a HumanML3D-layout folder ({info['mode']} features)"
  if not get_layout(data.layout).are_joints and "mode" in data and data.mode != info["mode"]:
    if (pathlib.Path(folders[0]) / "dataset.json").is_file():  # ours: the folder knows how its features were made
      data.mode = info["mode"]
  if data.get("mirror", False):
    data.mirror = False
    told += "; its mirrored copies are used, no more are made" if humanml3d.has_mirrored(folders[0]) else (
        "; it has no mirrored copies (`motion-jax data build` makes them unless --no-mirror)")
  return told


def load_clips(config):
  """The clips that a data section names: "synthetic" (seed, num_clips), or "archive" (folders; others may be folders in
  HumanML3D's layout, whose mirrored copies are left out where config.mirror makes them)."""
  if config.name == "synthetic":
    return synthetic.synthetic_clips(config.get("seed", 0), config.get("num_clips", 16))
  if config.name == "archive":
    if not config.folders:
      raise ValueError("data.folders is empty; give the archives, as in "
                       "--config.data.folders='(\"path/to/cmu\",\"path/to/bandai\")'")
    return [clip for folder in config.folders for clip in _clips_of(folder, config)]
  raise ValueError(f"got data.name {config.name!r}, expected synthetic, archive, {', '.join(_FOLDERS)}")


def _clips_of(folder, config):
  if archive.is_archive(folder):
    return archive.read_archive(folder)
  if kind_of(folder) != "humanml3d":
    raise InputError(f"{folder} is no archive and not in HumanML3D's layout; give folders of these kinds")
  clips = humanml3d.select_items(humanml3d.read_folder(folder), config.get("min_frames", 8), 10**9)
  if not config.get("mirror", False):
    return clips
  ids = {clip.id for clip in clips}
  return [clip for clip in clips if not (clip.id.startswith("M") and clip.id[1:] in ids)]


def _humanml3d(config, split, layout, captioned):
  items = humanml3d.text_items(config.folder, split, layout=layout, min_frames=config.get("min_frames"),
                               whole=not captioned)
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
  (docs/papers/cmdm.md#items).
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
    if not items:
      raise ValueError(f"{config.folder} has no clips for {config.name!r} in split {split!r}")
    if stats is None and config.get("per_column", False):  # which no data set's own files are
      stats = compute_stats(features, layout, per_column=True)
    stats = own_stats() if stats is None else stats
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
      stats = compute_stats(features, layout, config.get("per_axis", False), config.get("per_column", False))
  return FeatureSet([stats.normalize(x) for x in features], captions, groups, ids, stats, layout,
                    tokens)
