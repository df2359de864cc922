"""HumanML3D and KIT-ML folders, read and written: new_joint_vecs, new_joints, texts, splits, Mean and Std.

Source: docs/papers/cdamd.md#humanml3d, #items. The field's other tools can read a folder that `write_folder` wrote;
an additional `dataset.json` stores what that layout lacks: rate, mode of the features, sources, licences.
"""
import hashlib
import json
import pathlib
import warnings

import numpy as np
import tqdm

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import SHORTEST, Dataset, TestItem, TextItem, new_folder
from motion_jax.data.datasets.caption_lines import format_texts, read_texts
from motion_jax.data.datasets.humanml3d_files import MIN_FRAMES, dataset_info, read_ids
from motion_jax.data.mirror import mirror_clip
from motion_jax.motion import plausibility
from motion_jax.motion.representations import get_layout, layout_for, to_features, to_joints
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D, KIT
from motion_jax.motion.stats import ABSOLUTE, RunningStats, Stats, compute_stats, load_stats, save_stats
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npy

SPLITS = ("train", "val", "test", "train_val", "all")
TAG_FPS = 20  # Parity: time tags are seconds times 20 for KIT too, whose rate is 12.5


def has_mirrored(folder) -> bool:
  """Whether a folder holds mirrored copies, "M" before the id, as HumanML3D has and `data build` makes."""
  try:
    ids = set(read_ids(folder))
  except FileNotFoundError:
    return False
  return any("M" + name in ids for name in ids)


def read_folder(folder, split="all") -> list[Clip]:
  """Clips of a split with features, joints, captions and their spans; meta["tokens"] has the tokens of each caption.

  Motions that are missing, contain NaN or have no text are left out, as the field's loaders do; one warning counts
  them. Raises FileNotFoundError if the folder or the split file does not exist.
  """
  folder = pathlib.Path(folder)
  info = dataset_info(folder)
  layout = get_layout(info["layout"])
  member = {}
  for name in ("train", "val", "test"):
    if (folder / f"{name}.txt").is_file():
      member |= {clip: name for clip in read_ids(folder, name)}
  clips, lost = [], {"no motion": [], "no text": [], "NaN": [], "joints that are no person's": []}
  for name in read_ids(folder, split):
    vectors, texts = folder / "new_joint_vecs" / f"{name}.npy", folder / "texts" / f"{name}.txt"
    if not vectors.is_file() or not texts.is_file():
      lost["no text" if vectors.is_file() else "no motion"].append(name)
      continue
    features = load_npy(vectors).astype(np.float32)
    if features.ndim != 2 or not len(features) or not np.isfinite(features).all():
      lost["NaN"].append(name)
      continue
    layout.check(features)
    saved = folder / "new_joints" / f"{name}.npy"
    joints = _saved_joints(saved, layout) if saved.is_file() else to_joints(features, layout)
    if plausibility.fault(joints, layout.skeleton, info["fps"]):
      lost["joints that are no person's"].append(name)
      continue
    lines = read_texts(texts)
    origin = info.get("clips", {}).get(name, {})
    clips.append(Clip(
        joints=joints, fps=info["fps"], features=features, id=name,
        captions=tuple(Caption(line.caption, line.start, line.end) for line in lines), split=member.get(name, ""),
        source=str(origin.get("source", info["source"])), license=str(origin.get("license", info["license"])),
        skeleton=layout.skeleton, meta={"tokens": tuple(line.tokens for line in lines), "mode": info["mode"]}))
  if any(lost.values()):
    counts = "; ".join(f"{len(names)} with {what} ({', '.join(names[:3])})" for what, names in lost.items() if names)
    warnings.warn(f"{folder}: left out {counts}; motion-jax data doctor tells more", stacklevel=2)
  return clips


def _saved_joints(path, layout):
  joints, num = load_npy(path), layout.skeleton.num_joints
  if joints.size % (num * 3) or not joints.size:
    raise InputError(f"{path}: got joints of shape {joints.shape}, expected (frames, {num}, 3); make new_joints again "
                     "from the features")
  return joints.reshape((-1, num, 3))


def text_items(folder, split="train", layout=None, min_frames=None, max_frames=200, whole=False) -> list[TextItem]:
  """The items of a split by the loaders' rules (`select_items`), in the folder's layout or a given one.

  whole=True returns all whole clips of any length instead, each with all its captions, as autoencoders train on them.
  Essential features are the first columns of full features; coordinates are the joints.
  """
  stored = get_layout(dataset_info(folder)["layout"])
  layout = get_layout(layout or stored)
  _check_layout(folder, stored, layout)
  clips = read_folder(folder, split)
  if not whole:
    clips = select_items(clips, min_frames, max_frames)
  return [as_item(clip, layout) for clip in clips]


def as_item(clip, layout) -> TextItem:
  """A clip of `read_folder` or `select_items` as an item, in its own layout or one that is a part of it."""
  features = layout_for(clip.features.shape[-1]).narrow_to(clip.features, layout, clip.joints)
  return TextItem(clip.id, features, tuple(c.text for c in clip.captions), clip.meta["tokens"])


def folder_stats(folder, layout=None, per_axis=False) -> Stats:
  """The statistics of a folder, in its own layout or a given one.

  Those of essential features are the first columns of Mean.npy and Std.npy. Those of coordinates are Mean_abs.npy and
  Std_abs.npy where these exist; otherwise, with per_axis, and for steps they are computed from the training joints.
  """
  folder = pathlib.Path(folder)
  stored = get_layout(dataset_info(folder)["layout"])
  layout = get_layout(layout or stored)
  _check_layout(folder, stored, layout)
  if not layout.joints_suffice:
    stats, columns = load_stats(folder, stored), stored.columns_of(layout)
    return Stats(stats.mean[columns], stats.std[columns], layout)
  if layout.are_joints and not per_axis and all((folder / name).is_file() for name in ABSOLUTE):
    return load_stats(folder, layout, ABSOLUTE)
  features = [layout.of_joints(clip.joints) for clip in read_folder(folder, "train")]
  return compute_stats(features, layout, per_axis)


def _check_layout(folder, stored, layout):
  if not stored.narrows_to(layout):
    raise ValueError(f"{folder} holds {stored.name!r} features, got layout {layout.name!r}; choose a layout of "
                     f"skeleton {stored.skeleton.name!r}")


def select_items(clips, min_frames=None, max_frames=200) -> list[Clip]:
  """The items that text-to-motion loaders train on: clips with their whole-clip captions, and each time tag by itself.

  Items have min_frames <= rows < max_frames (min_frames: 40, KIT 24); a clip out of range is left out with all its
  pieces. A piece is rows int(start * 20):int(end * 20), named with a letter before the id ("A_000123"; the reference
  draws the letter at random). The clips need features.
  """
  items = []
  for clip in clips:
    if clip.features is None:
      raise ValueError(f"clip {clip.id!r} has no features; make them with "
                       "motion_jax.motion.representations.to_features")
    least = MIN_FRAMES[clip.skeleton.name] if min_frames is None else min_frames
    if not least <= len(clip.features) < max_frames:
      continue
    tokens = clip.meta.get("tokens", ((),) * len(clip.captions))
    whole = []
    pieces = 0
    for caption, words in zip(clip.captions, tokens):
      if caption.start == 0.0 and caption.end == 0.0:
        whole.append((caption, words))
        continue
      rows = slice(int(caption.start * TAG_FPS), int(caption.end * TAG_FPS))
      features = clip.features[rows]
      if least <= len(features) < max_frames:
        letter = chr(ord("A") + pieces % 26) * (1 + pieces // 26)
        items.append(_item(clip, f"{letter}_{clip.id}", features, clip.joints[rows], [(caption, words)]))
        pieces += 1
    if whole:
      items.append(_item(clip, clip.id, clip.features, clip.joints, whole))
  return items


def _item(clip, name, features, joints, captions):
  return clip.replace(id=name, features=features, joints=joints, captions=tuple(Caption(c.text) for c, _ in captions),
                      meta=clip.meta | {"tokens": tuple(words for _, words in captions)})


def write_folder(clips, out, mode="corrected", mirror=True, fps=None, overwrite=False, progress=False,
                 info=None) -> dict:
  """Writes clips as a HumanML3D-layout folder (KIT's for its skeleton) and returns the content of its dataset.json.

  Clips are resampled to the skeleton's rate (or fps), made canonical and converted to full features (`mode` as in
  `to_features`): T - 1 rows of T frames; the joints are recovered from these. With mirror, each clip is also written
  mirrored as "M" + id. A clip without a split goes to train. Mean and Std are over all files, the std by block. The
  folder is created only when everything has been written. Raises FileExistsError for a folder that exists, ValueError
  for ids that occur twice or clips of two skeletons.
  """
  clips = list(clips)
  _check_clips(clips, mirror)
  skeleton = clips[0].skeleton
  layout = get_layout("full" if skeleton is HUMANML3D else f"full_{skeleton.name}")
  fps = fps or skeleton.fps
  count, lengths, origins = RunningStats(layout), [], {}
  members = {split: [] for split in SPLITS}
  with new_folder(out, overwrite) as folder:
    for name in ("new_joints", "new_joint_vecs", "texts"):
      (folder / name).mkdir()
    for clip in tqdm.tqdm(clips, desc="clips", unit="clip", disable=not progress):
      split = clip.split or "train"
      for version in (clip, mirror_clip(clip)) if mirror else (clip,):
        joints = resample(version.joints.astype(np.float64), version.fps, fps) if version.fps != fps else version.joints
        if len(joints) < 2:
          raise ValueError(f"clip {clip.id!r} has {len(joints)} frame at {fps:g} frames a second, expected 2 or more")
        features = to_features(joints, layout, mode)
        np.save(folder / "new_joint_vecs" / f"{version.id}.npy", features)
        np.save(folder / "new_joints" / f"{version.id}.npy", to_joints(features, layout))
        (folder / "texts" / f"{version.id}.txt").write_text(format_texts(version), encoding="utf-8")
        count.add(features)
        lengths.append(len(features))
        origins[version.id] = {"source": clip.source, "license": clip.license}
        for member in (split, "all") + (("train_val",) if split in ("train", "val") else ()):
          members[member].append(version.id)
    for split, ids in members.items():
      (folder / f"{split}.txt").write_text("".join(f"{name}\n" for name in ids), encoding="utf-8")
    save_stats(count.stats(), folder)
    about = _describe(layout, fps, mode, members, lengths, origins) | (info or {})
    (folder / "dataset.json").write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
  return about


def _check_clips(clips, mirror):
  if not clips:
    raise ValueError("got no clips to write")
  names = {clip.skeleton.name for clip in clips}
  if len(names) > 1 or names - set(MIN_FRAMES):
    raise ValueError(f"got clips on the skeletons {', '.join(sorted(names))}, expected one of {', '.join(MIN_FRAMES)}")
  seen = set()
  for clip in clips:
    ids = {clip.id, "M" + clip.id} if mirror else {clip.id}
    if ids & seen:
      raise ValueError(f"id {clip.id!r} occurs twice (or is the mirrored name of another clip); ids name files")
    if "/" in clip.id or clip.id != clip.id.strip() or len(clip.id.split()) != 1:
      raise ValueError(f"id {clip.id!r} cannot be a file name and a line of a split file; use letters, digits, _ and -")
    if clip.split not in ("", "train", "val", "test"):
      raise ValueError(f"clip {clip.id!r} is in split {clip.split!r}, expected train, val or test")
    seen |= ids


def _describe(layout, fps, mode, members, lengths, origins):
  sources = {}
  for origin in origins.values():
    entry = sources.setdefault(origin["source"], {"clips": 0, "license": origin["license"]})
    entry["clips"] += 1
  return {"format": "HumanML3D", "layout": layout.name, "skeleton": layout.skeleton.name, "fps": fps, "mode": mode,
          "num_clips": len(lengths), "num_frames": int(sum(lengths)), "shortest": min(lengths), "longest": max(lengths),
          "splits": {split: len(members[split]) for split in ("train", "val", "test")},
          "source": ", ".join(sorted(sources)), "sources": sources,
          "license": "; ".join(sorted({entry["license"] for entry in sources.values() if entry["license"]})),
          "clips": origins if len(sources) > 1 else {},
          "tokens": "by rule (motion_jax.text.tagger), not by the parser of the official files"}


class HumanML3D(Dataset):
  """Folders in HumanML3D's layout: the data set itself, KIT-ML, and what `motion-jax data build` makes."""
  name, holds = "humanml3d", "HumanML3D's or KIT-ML's (new_joint_vecs, texts)"
  fields = ("mode", "mirror", "min_frames", "captioned")
  files = ("*.txt", "*.json", "*.npy", "new_*/*.npy", "texts/*.txt")
  judged_as = "humanml3d"

  def matches(self, folder):
    return any((pathlib.Path(folder) / name).is_dir() for name in ("new_joint_vecs", "new_joints"))

  def clips(self, folder, split=None, faults=None):
    split = split or "all"
    if faults is None:
      return read_folder(folder, split)
    with warnings.catch_warnings():
      warnings.simplefilter("ignore")  # clips that are left out are counted below
      clips = read_folder(folder, split)
    known = {clip.id for clip in clips}
    for name in read_ids(folder, split):
      if name not in known:
        missing = [part for part, suffix in (("new_joint_vecs", "npy"), ("texts", "txt"))
                   if not (pathlib.Path(folder) / part / f"{name}.{suffix}").is_file()]
        faults.append((name, f"no file in {missing[0]}" if missing else "NaN"))
    return clips

  def configure(self, data, folder):
    """Configures reading the folder's features unchanged, without adding mirrored copies."""
    data.update(name=self.name, folder=str(folder), folders=())
    info = dataset_info(folder)
    message = f"data: {folder}, a HumanML3D-layout folder ({info['mode']} features)"
    if not get_layout(data.layout).joints_suffice and "mode" in data and data.mode != info["mode"]:
      if (pathlib.Path(folder) / "dataset.json").is_file():  # ours: the folder knows how its features were made
        data.mode = info["mode"]
    if data.get("mirror", False):
      data.mirror = False
      message += "; its mirrored copies are used, no more are made" if has_mirrored(folder) else (
          "; it has no mirrored copies (`motion-jax data build` makes them unless --no-mirror)")
    return message

  def pieces(self, folder, config):
    """All clips, without the folder's mirrored copies if config.mirror makes new ones."""
    clips = select_items(read_folder(folder), config.get("min_frames", SHORTEST), 10**9)
    if not config.get("mirror", False):
      return clips
    ids = {clip.id for clip in clips}
    return [clip for clip in clips if not (clip.id.startswith("M") and clip.id[1:] in ids)]

  def items(self, config, split, layout, captioned=True):
    return text_items(config.folder, split, layout=layout, min_frames=config.get("min_frames"), whole=not captioned)

  def stats(self, config, layout, features):
    return folder_stats(config.folder, layout, config.get("per_axis", False))

  def examine(self, folder, tally, progress=False):
    from motion_jax.data.datasets import humanml3d_checks
    return humanml3d_checks.examine(pathlib.Path(folder), tally, progress)

  def benchmark(self, folders, run_layout):
    info = lambda folder: get_layout(dataset_info(folder)["layout"])
    if all((pathlib.Path(folder) / "dataset.json").is_file() and info(folder).skeleton is HUMANML3D
           for folder in folders):
      return "own-66"  # a folder of `motion-jax data build` is no benchmark of a paper's
    layout = get_layout(run_layout() or info(folders[0]))
    return "kit" if layout.skeleton is KIT else _BENCHMARKS.get(layout.name, "cmdm-259")

  def test_items(self, folder, rules, readers, excluded):
    stored = get_layout(dataset_info(folder)["layout"])
    layouts = {key: _layout_of(reader, folder, stored) for key, reader in readers.items()}
    clips = self.clips(folder, rules.split, excluded)
    for clip in select_items(clips, rules.min_frames, rules.past_frames):
      item = as_item(clip, next(iter(layouts.values())))
      yield TestItem(clip.id, item.captions, tuple(" ".join(words) or None for words in item.tokens), clip.features,
                     {key: as_item(clip, layout).features for key, layout in layouts.items()})

  def marks(self, folder, split):
    folder, marks = pathlib.Path(folder), {}
    for name in read_ids(folder, split) if (folder / f"{split}.txt").is_file() else ():
      path = folder / "new_joint_vecs" / f"{name}.npy"
      marks[folder.name, name.removeprefix("M")] = name
      if path.is_file():
        with open(path, "rb") as file:  # the first frames and the size tell motions apart
          marks[hashlib.sha256(file.read(8192)).digest(), path.stat().st_size] = name
    return marks


_BENCHMARKS = {"coordinates": "cdamd-66", "essential": "cmdm-67", "full": "cmdm-259"}


def _layout_of(reader, folder, stored):
  """The layout that an evaluator reads; it must be a part of the folder's own layout."""
  layout = reader.layout
  if not stored.narrows_to(layout):
    raise ValueError(f"{folder} holds {stored.name!r} features ({stored.dim} numbers a frame), evaluator "
                     f"{reader.name!r} reads {layout.name!r} ({layout.dim}); choose the evaluator of the data's "
                     "representation")
  return layout
