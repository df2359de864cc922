"""SnapMoGen folders, read and written: long recordings as 296 features, and spans of them with captions.

  renamed_feats/NAME.npy                       (rows, 296) of a whole recording, 30 frames a second
  data_split_info/{train,val,test}_fnames.txt  names of recordings, one a line
  data_split_info/{train,val,test}_ids.txt     ids NAME#start#end: rows of a recording, one a line
  all_caption_clean.json                       {id: {"manual": [captions], "gpt": [captions of a machine]}}
  meta_data/mean.npy, std.npy                  (296,) statistics

Source: docs/papers/cdamd.md#snapmogen-features, docs/papers/cmdm.md#snapmogen; the layout of
huggingface.co/datasets/Ericguo5513/SnapMoGen and of its loaders (snap-research/SnapMoGen, dataset/dataset.py).
"""
import collections
import json
import pathlib
import warnings

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset, TestItem, TextItem, new_folder
from motion_jax.data.datasets.snapmogen_files import (
  FPS,
  MIN_FRAMES,
  SPLITS,
  Span,
  folder_stats,
  ids_file,
  read_captions,
  read_ids,
)
from motion_jax.data.mocap.bvh import read_bvh
from motion_jax.motion.representations import get_layout, to_features, to_joints
from motion_jax.motion.representations.snapmogen import from_rotations
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import SNAPMOGEN, SNAPMOGEN_BVH
from motion_jax.motion.stats import RunningStats
from motion_jax.utils.input_files import load_npy

GAP = 30  # rows (one second): the longest gap between two consecutive motions


def is_snapmogen(folder) -> bool:
  return (pathlib.Path(folder) / "renamed_feats").is_dir()


def text_items(folder, split="train", layout="snapmogen", min_frames=MIN_FRAMES, whole=False,
               faults=None) -> list[TextItem]:
  """The captioned spans of a split with at least min_frames rows; whole=True: all spans, as autoencoders train on them.

  Spans longer than 320 frames are cut later, when a batch draws them. Layout "snapmogen_148" takes the evaluator's
  columns. Spans without a caption, and those whose recording is missing or contains NaN, are omitted with one warning,
  or added to `faults`, a list of (span, reason).
  """
  layout = get_layout(layout)
  if not get_layout("snapmogen").narrows_to(layout):
    raise ValueError(f"{folder} holds 'snapmogen' features, got layout {layout.name!r}; choose snapmogen or "
                     "snapmogen_148")
  captions, recordings = read_captions(folder), {}
  items, lost = [], collections.defaultdict(list)
  for span in read_ids(folder, split):
    if not whole and span.end - span.start < min_frames:
      continue
    if span.recording not in recordings:
      recordings[span.recording] = _read_recording(folder, span.recording)
    features, fault = recordings[span.recording]
    manual, machine = captions.get(span.id, ((), ()))
    if features is None or span.end > len(features) or not (manual or machine or whole):
      lost[fault or ("rows beyond the recording" if span.end > len(features) else "no caption")].append(span.id)
      continue
    items.append(TextItem(span.id, features[span.start:span.end, :layout.dim], manual + machine, ()))
  if faults is not None:
    faults += [(name, what) for what, names in lost.items() for name in names]
  elif lost:
    counts = "; ".join(f"{len(names)} with {what} ({', '.join(names[:3])})" for what, names in lost.items())
    warnings.warn(f"{folder}: left out {counts}; motion-jax data doctor tells more", stacklevel=2)
  return items


def longest_sequence(spans, gap=GAP) -> list[Span]:
  """The longest sequence of spans of one recording that do not overlap and are at most `gap` rows apart."""
  spans, chains = sorted(set(spans), key=lambda span: (span.start, span.end)), []
  for i, span in enumerate(spans):
    before = [chain for chain, last in zip(chains, spans[:i]) if 0 <= span.start - last.end <= gap]
    chains.append([*max(before, key=len, default=()), span])
  return max(chains, key=len, default=[])


def recordings(folder, split="test", more_than=5, shortest=1, gap=GAP, faults=None) -> list[list[TextItem]]:
  """Recordings with a sequence of more than `more_than` captioned motions: one list of pieces for each, 296 features.

  A piece ends where the next one begins, so the concatenated pieces are the recording itself; its id is
  "NAME#start#end" of these rows. Spans of fewer than `shortest` rows are skipped. faults: as for `text_items`.
  """
  by_recording = {}
  for item in text_items(folder, split, min_frames=shortest, faults=faults):
    name, start, end = item.id.rsplit("#", 2)
    by_recording.setdefault(name, {})[Span(name, int(start), int(end))] = item
  kept = []
  for name, items in by_recording.items():
    chain = longest_sequence(items, gap)
    if len(chain) <= more_than:
      continue
    features, _ = _read_recording(folder, name)
    ends = [span.start for span in chain[1:]] + [chain[-1].end]
    kept.append([items[span]._replace(id=Span(name, span.start, end).id, features=features[span.start:end])
                 for span, end in zip(chain, ends)])
  return kept


def _read_recording(folder, name):
  """Reads a recording -> (features, "") or (None, the fault)."""
  path = pathlib.Path(folder) / "renamed_feats" / f"{name}.npy"
  if not path.is_file():
    return None, "no recording"
  features = load_npy(path)
  if features.ndim != 2 or features.shape[1] != 296:
    raise ValueError(f"{path}: got features of shape {features.shape}, expected (rows, 296); they belong to another "
                     "representation")
  if not np.isfinite(features).all():
    return None, "NaN"
  return features.astype(np.float32), ""


def read_folder(folder, split="train", faults=None) -> list[Clip]:
  """The captioned spans of a split as clips on SnapMoGen's skeleton, with joints recovered from the features.

  faults: as for `text_items`.
  """
  captions = read_captions(folder)
  return [Clip(joints=to_joints(item.features, "snapmogen"), fps=FPS, id=item.id, split=split, source="SnapMoGen",
               captions=tuple(Caption(text) for text in item.captions), skeleton=SNAPMOGEN, features=item.features,
               meta={"num_manual": len(captions[item.id][0])})
          for item in text_items(folder, split, min_frames=0, faults=faults)]


def bvh_features(path, mode="benchmark", drop_first=True):
  """Features (rows, 296), float32, of a BVH file on SnapMoGen's skeleton.

  The file is in centimetres and has 30 frames a second or a multiple. Other joints of the file are ignored. drop_first
  leaves out the first frame, as the reference does. Raises ValueError for a file of another skeleton or rate.
  """
  capture = read_bvh(path)
  missing = [name for name in SNAPMOGEN_BVH if name not in capture.names]
  if missing:
    raise ValueError(f"{path} has no joint {missing[0]!r} ({len(missing)} of 24 missing); expected SnapMoGen's figure; "
                     "for another one: data.mocap.bvh.bvh_clip, then Clip.on_skeleton")
  step = round(capture.fps / FPS)
  if step < 1 or abs(capture.fps - step * FPS) > 0.01 * FPS:
    raise ValueError(f"{path} has {capture.fps:g} frames a second, expected {FPS:g} or a multiple of it")
  order = [capture.names.index(name) for name in SNAPMOGEN_BVH]
  frames = np.arange(int(drop_first), capture.num_frames, step)
  if len(frames) < 2:
    raise ValueError(f"{path} has {len(frames)} frames to use, expected 2 or more")
  joints, turned = capture.positions[frames][:, order], capture.turned[frames][:, order]
  return from_rotations(joints, turned, mode).astype(np.float32)


def write_folder(clips, out, mode="benchmark", overwrite=False) -> pathlib.Path:
  """Writes clips on SnapMoGen's skeleton as a SnapMoGen folder, one recording each.

  Captions of the same seconds share an id. meta["num_manual"] is the number of captions of a clip that people wrote;
  the rest go to "gpt"; without it all are "manual". Features that a clip has are written unchanged. Statistics are over
  all recordings, the std by block. The folder is created only when everything has been written.
  """
  clips = list(clips)
  _check_clips(clips)
  layout = get_layout("snapmogen")
  count, captions = RunningStats(layout), {}
  names, ids = ({split: [] for split in SPLITS} for _ in range(2))
  with new_folder(out, overwrite) as folder:
    for part in ("renamed_feats", "data_split_info", "meta_data"):
      (folder / part).mkdir()
    for clip in clips:
      features, split = clip.features, clip.split or "train"
      if features is None:
        joints = clip.joints if clip.fps == FPS else resample(clip.joints.astype(np.float64), clip.fps, FPS)
        features = to_features(joints, layout, mode)
      np.save(folder / "renamed_feats" / f"{clip.id}.npy", features)
      count.add(features)
      names[split].append(clip.id)
      manual = clip.meta.get("num_manual", len(clip.captions))
      for place, caption in enumerate(clip.captions):
        span = Span(clip.id, *caption.frames(FPS, len(features))).id
        entry = captions.setdefault(span, {"manual": [], "gpt": []})
        entry["manual" if place < manual else "gpt"].append(caption.text)
        if span not in ids[split]:
          ids[split].append(span)
    for split in SPLITS:
      for kind, lines in (("fnames", names[split]), ("ids", ids[split])):
        text = "".join(f"{line}\n" for line in lines)
        (folder / "data_split_info" / f"{split}_{kind}.txt").write_text(text, encoding="utf-8")
    (folder / "all_caption_clean.json").write_text(json.dumps(captions, indent=1, ensure_ascii=False) + "\n",
                                                   encoding="utf-8")
    stats = count.stats()
    np.save(folder / "meta_data" / "mean.npy", stats.mean)
    np.save(folder / "meta_data" / "std.npy", stats.std)
    about = {"format": "SnapMoGen", "layout": layout.name, "fps": FPS, "mode": mode, "num_clips": len(clips)}
    (folder / "dataset.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
  return pathlib.Path(out)


def _check_clips(clips):
  if not clips:
    raise ValueError("got no clips to write")
  seen = set()
  for clip in clips:
    if clip.skeleton is not SNAPMOGEN:
      raise ValueError(f"clip {clip.id!r} is on skeleton {clip.skeleton.name!r}, expected 'snapmogen'; "
                       "Clip.on_skeleton brings 22 joints there")
    if clip.id in seen or "#" in clip.id or "/" in clip.id or len(clip.id.split()) != 1:
      raise ValueError(f"id {clip.id!r} occurs twice, or cannot be a file name without '#'; ids name recordings")
    if clip.split not in ("", *SPLITS):
      raise ValueError(f"clip {clip.id!r} is in split {clip.split!r}, expected {', '.join(SPLITS)}")
    seen.add(clip.id)


class SnapMoGen(Dataset):
  """Folders of SnapMoGen's layout, with features of their own."""
  name, holds = "snapmogen", "SnapMoGen's (renamed_feats)"
  by_clip, fields = False, ("captioned",)
  judged_as = "snapmogen"

  def matches(self, folder):
    return is_snapmogen(folder)

  def clips(self, folder, split=None, faults=None):
    splits = [split] if split else [name for name in SPLITS if ids_file(folder, name).is_file()]
    return [clip for name in splits for clip in read_folder(folder, name, faults)]

  def items(self, config, split, layout, captioned=True):
    return text_items(config.folder, split, layout, whole=not captioned)

  def stats(self, config, layout, features):
    return folder_stats(config.folder, layout)

  def examine(self, folder, tally, progress=False):
    from motion_jax.data.datasets import snapmogen_checks
    return snapmogen_checks.examine(pathlib.Path(folder), tally, progress)

  def benchmark(self, folders, run_layout):
    return "snapmogen"

  def test_items(self, folder, rules, readers, excluded):
    layout = get_layout("snapmogen")
    for reader in readers.values():
      if not layout.narrows_to(reader.layout):
        raise ValueError(f"{folder} holds 'snapmogen' features, evaluator {reader.name!r} reads "
                         f"{reader.layout.name!r}; choose the evaluator of the data's representation")
    if rules.recorded:
      selected = recordings(folder, rules.split, rules.recorded, rules.min_frames, faults=excluded)
      items = [item for pieces in selected for item in pieces]
    else:
      items = text_items(folder, rules.split, min_frames=rules.min_frames, faults=excluded)
    for item in {item.id: item for item in items}.values():  # a split may name a span twice
      yield TestItem(item.id, item.captions, (None,) * len(item.captions), item.features,
                     {key: layout.narrow_to(item.features, reader.layout) for key, reader in readers.items()})

  def marks(self, folder, split):
    return {}

  def overlaps(self, folder, split):
    train = collections.defaultdict(list)
    spans = lambda name: read_ids(folder, name) if ids_file(folder, name).is_file() else []
    for span in spans("train"):
      train[span.recording].append(span)
    return [span.id for span in spans(split)
            if any(span.start < other.end and other.start < span.end for other in train[span.recording])]
