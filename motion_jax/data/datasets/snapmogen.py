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
import re
import warnings
from typing import NamedTuple

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset, TestItem, TextItem, new_folder
from motion_jax.data.mocap.bvh import read_bvh
from motion_jax.motion.representations import get_layout, to_features, to_joints
from motion_jax.motion.representations.snapmogen import from_rotations
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import SNAPMOGEN, SNAPMOGEN_BVH
from motion_jax.motion.stats import RunningStats, Stats
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npy, read_json
from motion_jax.utils.numerals import shortened
from motion_jax.utils.text_files import file_stem, read_lines

SPLITS = ("train", "val", "test")
MIN_FRAMES = 128
FPS = SNAPMOGEN.fps
GAP = 30  # rows (one second): the longest gap between two consecutive motions


class Span(NamedTuple):
  """Rows start:end of a recording; its id in files is "NAME#start#end"."""
  recording: str
  start: int
  end: int

  @property
  def id(self) -> str:
    return f"{self.recording}#{self.start}#{self.end}"


def is_snapmogen(folder) -> bool:
  return (pathlib.Path(folder) / "renamed_feats").is_dir()


def read_ids(folder, split="train") -> list[Span]:
  """The spans of a split. Raises FileNotFoundError if the file is missing, ValueError for a line that is no id."""
  if split not in SPLITS:
    raise ValueError(f"got split {split!r}, expected one of {', '.join(SPLITS)}")
  path = ids_file(folder, split)
  need(path, "ids NAME#start#end, one a line")
  spans = []
  for number, line in enumerate(read_lines(path), 1):
    if not line.strip():
      continue
    parts = line.strip().rsplit("#", 2)
    numbers = [int(part) for part in parts[1:] if re.fullmatch("[0-9]{1,9}", part)]
    if len(numbers) != 2 or not numbers[0] < numbers[1]:
      raise InputError(f"{path} line {number}: got {shortened(line.strip())!r}, expected NAME#start#end with start "
                       "before end")
    spans.append(Span(file_stem(parts[0], f"{path} line {number}"), *numbers))
  return spans


def ids_file(folder, split):
  return pathlib.Path(folder) / "data_split_info" / f"{split}_ids.txt"


def read_captions(folder) -> dict[str, tuple[tuple[str, ...], tuple[str, ...]]]:
  """Captions by id: (captions written by people, captions written by a machine)."""
  path = pathlib.Path(folder) / "all_caption_clean.json"
  need(path, 'a JSON object {id: {"manual": [...], "gpt": [...]}}')
  table = {}
  for name, entry in read_json(path).items():
    lists = [entry.get(kind, []) for kind in ("manual", "gpt")] if isinstance(entry, dict) else [None]
    if not all(isinstance(one, list) and all(isinstance(text, str) for text in one) for one in lists):
      raise InputError(f'{path}: {shortened(name)!r} holds no object {{"manual": [captions], "gpt": [captions]}}')
    table[name] = tuple(map(tuple, lists))
  return table


def folder_stats(folder, layout="snapmogen") -> Stats:
  """The dataset's own statistics. Columns that never move (root's x and z among the positions) have std 1."""
  layout, values = get_layout(layout), []
  for name in ("mean", "std"):
    path = pathlib.Path(folder) / "meta_data" / f"{name}.npy"
    need(path, "the dataset's statistics, (296,)")
    value = load_npy(path).astype(np.float32).ravel()
    if value.shape != (296,):
      raise ValueError(f"{path}: got shape {value.shape}, expected (296,); these statistics belong to another "
                       "representation")
    values.append(value[get_layout("snapmogen").columns_of(layout)])
  return Stats(values[0], np.where(np.abs(values[1]) < 1e-8, np.float32(1), values[1]), layout)


def need(path, what):
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}; expected {what}: a SnapMoGen folder has renamed_feats/, "
                            "data_split_info/, meta_data/ and all_caption_clean.json")


def text_items(folder, split="train", layout="snapmogen", min_frames=MIN_FRAMES, whole=False,
               faults=None) -> list[TextItem]:
  """The captioned spans of a split with at least min_frames rows; whole=True: all spans, as autoencoders train on them.

  Spans longer than 320 frames are cut later, when a batch draws them. Layout "snapmogen_148" takes the evaluator's
  columns. Spans without a caption, and those whose recording is missing or contains NaN, are left out with one warning,
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
  found = {}
  for item in text_items(folder, split, min_frames=shortest, faults=faults):
    name, start, end = item.id.rsplit("#", 2)
    found.setdefault(name, {})[Span(name, int(start), int(end))] = item
  kept = []
  for name, items in found.items():
    chain = longest_sequence(items, gap)
    if len(chain) <= more_than:
      continue
    features, _ = _read_recording(folder, name)
    ends = [span.start for span in chain[1:]] + [chain[-1].end]
    kept.append([items[span]._replace(id=Span(name, span.start, end).id, features=features[span.start:end])
                 for span, end in zip(chain, ends)])
  return kept


def _read_recording(folder, name):
  """(features, "") or (None, the fault)."""
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

  def examine(self, folder, found, progress=False):
    from motion_jax.data.datasets import snapmogen_checks  # reads folders by this file
    return snapmogen_checks.examine(pathlib.Path(folder), found, progress)

  def benchmark(self, folders, run_layout):
    return "snapmogen"

  def test_items(self, folder, rules, readers, excluded):
    own = get_layout("snapmogen")
    for reader in readers.values():
      if not own.narrows_to(reader.layout):
        raise ValueError(f"{folder} holds 'snapmogen' features, evaluator {reader.name!r} reads "
                         f"{reader.layout.name!r}; choose the evaluator of the data's representation")
    if rules.recorded:
      selected = recordings(folder, rules.split, rules.recorded, rules.min_frames, faults=excluded)
      found = [item for pieces in selected for item in pieces]
    else:
      found = text_items(folder, rules.split, min_frames=rules.min_frames, faults=excluded)
    for item in {item.id: item for item in found}.values():  # a split may name a span twice
      yield TestItem(item.id, item.captions, (None,) * len(item.captions), item.features,
                     {key: own.narrow_to(item.features, reader.layout) for key, reader in readers.items()})

  def marks(self, folder, split):
    return {}

  def overlaps(self, folder, split):
    train = collections.defaultdict(list)
    spans = lambda name: read_ids(folder, name) if ids_file(folder, name).is_file() else []
    for span in spans("train"):
      train[span.recording].append(span)
    return [span.id for span in spans(split)
            if any(span.start < other.end and other.start < span.end for other in train[span.recording])]
