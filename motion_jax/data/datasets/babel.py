"""BABEL in FlowMDM's form, read and written: SMPL motions with labelled seconds, and pairs of adjacent segments.

  train.json, val.json   BABEL's own annotations: {SID: {"frame_ann": {"labels": [{"proc_label", "start_t", "end_t"}]}}}
  motions/SID.npz        poses (T, 66 or more) SMPL rotation vectors, trans (T, 3) metres, z up, and the rate: what
                         AMASS files hold (mocap_framerate or mocap_frame_rate) or fps
  Mean.npy, Std.npy      (135,) statistics; without them they are computed from the training pieces

Motions become 135 features (`motion.representations.babel`) piece by piece, each turned by its own first frame.
Evaluation is on "val": BABEL's test labels are not public. Source: docs/papers/cmdm.md#long-horizon, #data-sets; the
rules are those of BarqueroGerman/FlowMDM (data_loaders/amass/babel_flowmdm.py), whose own data files are pickles, which
this library does not open: copy poses, trans and rate of each entry to motions/SID.npz. Spelling of labels is not
corrected, as theirs is.
"""
import collections
import json
import pathlib
import warnings
from typing import NamedTuple

import numpy as np
import tqdm

from motion_jax.data import checks
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset, TestItem, TextItem, new_folder
from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import get_layout, to_joints
from motion_jax.motion.representations.babel import from_ours, from_rotations
from motion_jax.motion.skeleton import SMPL
from motion_jax.motion.stats import Stats, compute_stats, load_stats, save_stats
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.input_files import load_npz, npz_names, read_json
from motion_jax.utils.numerals import shortened
from motion_jax.utils.text_files import file_stem

SPLITS = ("train", "val")
FPS = SMPL.fps
MIN_FRAMES, MAX_FRAMES = 30, 200
KINDS = ("pairs", "segments", "both")
_BETWEEN = "transition"  # a label of no action


class Segment(NamedTuple):
  """A label of frames start:end of a recording."""
  text: str
  start: int
  end: int


class Piece(NamedTuple):
  """An item of a loader: features (T, 135), captions, and its segments in frames of the piece."""
  id: str
  features: np.ndarray
  captions: tuple[str, ...]
  tokens: tuple[tuple[str, ...], ...]
  segments: tuple[Segment, ...]


class Recording(NamedTuple):
  rotations: np.ndarray    # (T, 22, 4) quaternions relative to the parents
  translation: np.ndarray  # (T, 3) metres, z up
  fps: float = FPS


def is_babel(folder) -> bool:
  folder = pathlib.Path(folder)
  return (folder / "motions").is_dir() and any((folder / f"{split}.json").is_file() for split in SPLITS)


def read_annotations(folder, split="train") -> dict:
  """BABEL's annotations of a split by id."""
  path = pathlib.Path(folder) / f"{split}.json"
  if split not in SPLITS:
    raise ValueError(f"got split {split!r}, expected one of {', '.join(SPLITS)}")
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}; a BABEL folder has train.json, val.json (the annotations of "
                            "babel.is.tue.mpg.de) and motions/SID.npz")
  table = read_json(path)
  strange = next((name for name, entry in table.items() if not isinstance(entry, dict)), None)
  if strange is not None:
    raise InputError(f"{path} is no JSON object of BABEL annotations: {shortened(strange)!r} holds no object")
  for name in table:
    file_stem(name, path)
  return table


RATES = "fps", "mocap_framerate", "mocap_frame_rate"
_MOST_RADIANS = 1000.0  # largest angle of a rotation vector that counts as valid
_FARTHEST = 1e6  # metres, or units, of a place that counts as valid


def read_recording(path) -> Recording:
  """`read_poses` at 30 frames a second; faster files are thinned as FlowMDM does, slower ones are an error."""
  rotations, translation, fps = read_poses(path)
  if not FPS * 0.99 <= fps:
    raise ValueError(f"{path} has {fps:g} frames a second, expected {FPS:g} or more")
  if fps > FPS * 1.01:
    frames = np.linspace(0, len(rotations) - 1, num=int(len(rotations) * FPS / fps), dtype=int)
    rotations, translation = rotations[frames], translation[frames]
  return Recording(rotations, translation)


def read_poses(path, names=None, fps=None) -> Recording:
  """Reads a motion file at its own rate: poses (T, 66 or more) or root_orient and pose_body, trans (T, 3), and a rate.

  Rotations may be matrices (T, ..., 3, 3). names: {one of these arrays: its name in the file, or several possible
  names}. fps: the rate of a file that states none.
  """
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}; expected SMPL poses and trans, as AMASS files hold them")
  there = set(npz_names(path))
  called = {name: next((other for other in _several((names or {}).get(name, name)) if other in there), name)
            for name in ("poses", "root_orient", "pose_body", "trans")}
  file = load_npz(path, (*called.values(), *RATES), required=(called["trans"],))
  file = {name: file[other] for name, other in called.items() if other in file} | {
      name: file[name] for name in RATES if name in file}
  file |= {name: _vectors(file[name]) for name in ("poses", "root_orient", "pose_body") if name in file}
  if "poses" not in file and {"root_orient", "pose_body"} <= set(file):
    root, body = file["root_orient"], file["pose_body"]
    if root.ndim != 2 or body.ndim != 2 or len(root) != len(body):
      raise InputError(f"{path}: got root_orient {root.shape} and pose_body {body.shape}, expected (T, 3) and (T, 63)")
    file["poses"] = np.concatenate([root, body], axis=1)
  if "poses" not in file:
    raise InputError(f"{path} lacks poses; it holds {', '.join(npz_names(path))}")
  rate = next((name for name in RATES if name in file), None)
  if rate is None and fps is not None:
    rate, file["fps"] = "fps", np.float64(fps)
  if rate is None:
    raise InputError(f"{path} has no fps; expected poses, trans and fps (or AMASS's mocap_framerate)")
  poses, translation, fps = (np.asarray(file[name], np.float64) for name in ("poses", "trans", rate))
  if fps.size != 1:
    raise InputError(f"{path}: got a rate of shape {fps.shape}, expected one number of frames a second")
  fps = float(fps.item())
  if poses.ndim != 2 or poses.shape[1] < 66 or translation.shape != (len(poses), 3) or not len(poses):
    raise ValueError(f"{path}: got poses {poses.shape} and trans {translation.shape}, expected (T, 66 or more) and "
                     "(T, 3)")
  if not ((np.abs(poses) < _MOST_RADIANS).all() and (np.abs(translation) < _FARTHEST).all()):
    raise InputError(f"{path} holds NaN, infinity, angles of over {_MOST_RADIANS:g} radians or places beyond "
                     f"{_FARTHEST:g}; leave the file out or take it from AMASS again")
  if not 0 < fps < np.inf:
    raise InputError(f"{path} has {fps:g} frames a second, expected a rate")
  return Recording(rot.from_vector(poses[:, :66].reshape(-1, 22, 3)), translation, fps)


def _vectors(rotations):
  """Rotation vectors (T, 3 N) of vectors (T, ..., 3) or matrices (T, ..., 3, 3)."""
  rotations = np.asarray(rotations, np.float64)
  if rotations.ndim > 2 and rotations.shape[-2:] == (3, 3):
    rotations = rot.to_vector(rot.from_matrix(rotations))
  return rotations.reshape(len(rotations), -1) if rotations.ndim > 1 and rotations.size else rotations


def _several(names):
  return (names,) if isinstance(names, str) else names


def read_segments(annotation, num_frames) -> list[Segment]:
  """The labelled segments of a recording, sorted; if several have equal frames, the last one is used.

  Raises InputError for invalid labels.
  """
  segments = {}
  with reading("frame_ann", 'expected {"labels": [{"proc_label": words, "start_t": seconds, "end_t": seconds}, ...]}'):
    for label in (annotation.get("frame_ann") or {}).get("labels") or ():
      text = label.get("proc_label") or label.get("raw_label") or ""
      start, end = int(label["start_t"] * FPS), min(num_frames, int(label["end_t"] * FPS))
      if not isinstance(text, str) or start < 0:
        raise InputError(f"frame_ann: got the label {str(label)[:80]}, expected words and seconds from 0 on")
      if text and start < end:
        segments[start, end] = text
  return [Segment(text, start, end) for (start, end), text in sorted(segments.items())]


def pairs(segments) -> list[tuple[Segment, Segment]]:
  """Pairs of adjacent segments, adjusted to touch: the second begins where the first ends.

  Segment b follows a if it begins inside a and ends after it, or if a transition begins inside a, and b inside the
  transition. Overlapping frames, or the transition, are halved.
  """
  follows = lambda a, b: a.start < b.start <= a.end < b.end
  acts = [segment for segment in segments if segment.text != _BETWEEN]
  bridges = [segment for segment in segments if segment.text == _BETWEEN and segment.start > 0]
  adjacent = {}
  for a in acts:
    for b in acts:
      if follows(a, b) or any(follows(a, t) and follows(t, b) for t in bridges):
        # Parity: as FlowMDM's process_actions, whose ends are inclusive.
        border = a.end + (b.start - a.end) // 2 + 1
        if a.start < border < b.end:
          adjacent[a.start, b.end, border] = a._replace(end=border), b._replace(start=border)
  return [adjacent[key] for key in sorted(adjacent)]


def pieces(folder, split="train", kind="pairs", min_frames=MIN_FRAMES, max_frames=MAX_FRAMES, whole=False,
           mode="benchmark", faults=None) -> list[Piece]:
  """Pairs of adjacent segments, single segments, or both, of min_frames to max_frames frames each.

  A pair's caption is "a, b", as in TEACH; `segments` has the border. whole: whole recordings instead, in pieces of
  max_frames without captions, for autoencoders. Unreadable recordings are omitted with one warning that counts them, or
  appended to `faults`, a list of (recording, reason).
  """
  if kind not in KINDS:
    raise ValueError(f"got kind {kind!r}, expected one of {', '.join(KINDS)}")
  folder, drawn, lost = pathlib.Path(folder), [], []
  for name, annotation in sorted(read_annotations(folder, split).items()):
    if not whole and not annotation.get("frame_ann"):
      continue
    try:
      recording = read_recording(folder / "motions" / f"{name}.npz")
      segments = [] if whole else read_segments(annotation, len(recording.translation))
    except (ValueError, FileNotFoundError) as error:
      lost.append((name, error))
      continue
    if whole:
      frames = range(0, len(recording.translation), max_frames)
      parts = [(Segment("", start, min(start + max_frames, len(recording.translation))),) for start in frames]
    else:
      parts = pairs(segments) if kind in ("pairs", "both") else []
      if kind in ("segments", "both"):
        parts += [(segment,) for segment in segments if segment.text != _BETWEEN]
    drawn += [_piece(name, recording, part, mode) for part in parts
             if min_frames <= part[-1].end - part[0].start <= max_frames]
  if faults is not None:
    faults += [(name, str(error)) for name, error in lost]
  elif lost:
    warnings.warn(f"{folder}: left out {len(lost)} recordings, the first {lost[0][0]}: {lost[0][1]}", stacklevel=2)
  return drawn


def _piece(name, recording, part, mode):
  first, last = part[0].start, part[-1].end
  features = from_rotations(recording.rotations[first:last], recording.translation[first:last], mode)
  text = ", ".join(segment.text for segment in part)
  segments = tuple(segment._replace(start=segment.start - first, end=segment.end - first) for segment in part)
  return Piece(f"{name}#{first}#{last}", features.astype(np.float32), (text,) if text else (), (), segments)


def read_folder(folder, split="train", kind="segments", **rules) -> list[Clip]:
  """Pieces as clips of 22 joints with an adult's bones; a pair has one caption, with times, for each segment."""
  return [Clip(joints=to_joints(piece.features, "babel"), fps=FPS, id=piece.id, split=split, source="BABEL",
               captions=_captions(piece.segments), skeleton=SMPL, features=piece.features)
          for piece in pieces(folder, split, kind, **rules)]


def _captions(segments):
  if len(segments) == 1:
    return (Caption(segments[0].text),)
  return tuple(Caption(segment.text, segment.start / FPS, segment.end / FPS) for segment in segments)


def folder_stats(folder, mode="benchmark") -> Stats:
  """Mean.npy and Std.npy of the folder, or else the statistics of the training recordings, with std by block."""
  if (pathlib.Path(folder) / "Mean.npy").is_file():
    return load_stats(folder, "babel")
  return compute_stats([piece.features for piece in pieces(folder, whole=True, min_frames=2, mode=mode)], "babel")


def write_folder(clips, out, overwrite=False) -> pathlib.Path:
  """Writes clips of 22 SMPL joints, 30 frames a second, as a BABEL folder: poses from positions, captions as labels.

  A caption without times is a label of the whole clip. A clip without a split goes to train. Statistics are those of
  the training recordings. The folder is created only when everything has been written.
  """
  clips = list(clips)
  _check_clips(clips)
  tables = {split: {} for split in SPLITS}
  with new_folder(out, overwrite) as folder:
    (folder / "motions").mkdir()
    for clip in clips:
      joints = clip.joints.astype(np.float64)
      rotations, translation = from_ours(joints, inverse.world_rotations(joints, SMPL))
      np.savez(folder / "motions" / f"{clip.id}.npz", poses=rot.to_vector(rotations).reshape(len(joints), -1),
               trans=translation, fps=np.float64(clip.fps))
      labels = [{"proc_label": c.text, "raw_label": c.text, "start_t": c.start, "end_t": c.end or clip.seconds}
                for c in clip.captions]
      tables[clip.split or "train"][clip.id] = {"babel_sid": clip.id, "dur": clip.seconds,
                                                "frame_ann": {"labels": labels} if labels else None}
    for split, table in tables.items():
      (folder / f"{split}.json").write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    about = {"format": "BABEL", "layout": "babel", "fps": FPS, "num_clips": len(clips)}
    (folder / "dataset.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    if tables["train"]:
      save_stats(folder_stats(folder), folder)
  return pathlib.Path(out)


def _check_clips(clips):
  if not clips:
    raise ValueError("got no clips to write")
  seen = set()
  for clip in clips:
    if clip.skeleton is not SMPL or clip.fps != FPS:
      raise ValueError(f"clip {clip.id!r} is on skeleton {clip.skeleton.name!r} at {clip.fps:g} frames a second, "
                       "expected 'smpl' at 30; Clip.on_skeleton brings HumanML3D's joints there")
    if clip.id in seen or "/" in clip.id or len(clip.id.split()) != 1:
      raise ValueError(f"id {clip.id!r} occurs twice, or cannot be a file name; ids name motion files")
    if clip.split not in ("", *SPLITS):
      raise ValueError(f"clip {clip.id!r} is in split {clip.split!r}, expected train or val")
    seen.add(clip.id)


class Babel(Dataset):
  """Folders of BABEL's annotations and SMPL motions."""
  name, holds = "babel", "BABEL's (motions, val.json)"
  by_clip, fields = False, ("mode", "kind", "captioned")
  judged_as = long_horizon = "babel"

  def matches(self, folder):
    return is_babel(folder)

  def clips(self, folder, split=None, faults=None):
    splits = [split] if split else [name for name in SPLITS if (pathlib.Path(folder) / f"{name}.json").is_file()]
    return [clip for name in splits for clip in read_folder(folder, name, faults=faults)]

  def items(self, config, split, layout, captioned=True):
    if layout.name != "babel":
      raise ValueError(f"BABEL's motions become 'babel' features, got layout {layout.name!r}")
    drawn = pieces(config.folder, split, config.get("kind", "pairs"), whole=not captioned, mode=config.mode)
    return [TextItem(piece.id, piece.features, piece.captions, piece.tokens) for piece in drawn]

  def stats(self, config, layout, features):
    return folder_stats(config.folder, config.mode)

  def examine(self, folder, tally, progress=False):
    return _examine(pathlib.Path(folder), tally, progress)

  def benchmark(self, folders, run_layout):
    return "babel"

  def test_items(self, folder, rules, readers, excluded):
    for reader in readers.values():
      if not get_layout("babel").narrows_to(reader.layout):
        raise ValueError(f"{folder} becomes 'babel' features, evaluator {reader.name!r} reads {reader.layout.name!r}; "
                         "choose the evaluator of the data's representation")
    for piece in pieces(folder, rules.split, "segments", rules.min_frames, rules.past_frames - 1, faults=excluded):
      yield TestItem(piece.id, piece.captions, (None,) * len(piece.captions), piece.features,
                     dict.fromkeys(readers, piece.features))

  def marks(self, folder, split):
    folder = pathlib.Path(folder)
    there = (folder / f"{split}.json").is_file()
    return {(folder.name, name): name for name in read_annotations(folder, split)} if there else {}


# --- checks of the doctor --------------------------------------------------------------------------------------------


def _examine(folder, tally, progress):
  """Facts about a BABEL folder: recordings, labels, pairs of adjacent segments, and bodies of the features."""
  folder, layout, facts = pathlib.Path(folder), get_layout("babel"), [("format", "BABEL in FlowMDM's form")]
  body, seen = checks.Body(tally, layout.skeleton), collections.defaultdict(set)
  labels = collections.defaultdict(list)
  for split in SPLITS:
    try:
      table = read_annotations(folder, split)
    except (FileNotFoundError, ValueError) as error:
      tally.add("error" if split == "train" else "warning", f"no {split}.json", "BABEL's annotations of the split",
                checks.error_detail(error, folder)[:120])
      continue
    num_pairs = num_segments = num_frames = 0
    for name, annotation in tqdm.tqdm(sorted(table.items()), desc=split, unit="recording", disable=not progress):
      seen[name].add(split)
      try:
        recording = read_recording(folder / "motions" / f"{name}.npz")
        segments = read_segments(annotation, len(recording.translation))
      except FileNotFoundError:
        tally.add("error", "annotations without a motion", "restore motions/SID.npz from AMASS", name)
        continue
      except (ValueError, OSError) as error:
        tally.add("error", "motions or labels that cannot be read", "poses, trans and fps, as AMASS files have them",
                  f"{name} ({checks.error_detail(error, folder)})"[:120])
        continue
      labels[split] += [segment.text for segment in segments]
      num_frames += len(recording.translation)
      num_segments, num_pairs = num_segments + len(segments), num_pairs + len(pairs(segments))
      if len(recording.translation) > 1:
        features = from_rotations(recording.rotations, recording.translation, "corrected")
        body.check(name, to_joints(features.astype(np.float32), layout))
    facts.append((split, f"{len(table)} recordings, {num_frames / FPS / 3600:.2f} hours, {num_segments} labels, "
                  f"{num_pairs} pairs of adjacent ones"))
    if not num_pairs:
      tally.add("warning", f"no pair of adjacent segments in {split}", "two pair if one begins in the other")
  body.report()
  tally.add_all("error", "recordings in two splits", checks.LEAK,
                sorted(n for n, splits in seen.items() if len(splits) > 1))
  try:
    if (folder / "Mean.npy").is_file():
      folder_stats(folder)
    else:
      tally.add("note", "no Mean.npy and Std.npy", "fine: they are computed from the training recordings")
  except (FileNotFoundError, ValueError) as error:
    tally.add("error", "statistics that do not fit", "delete Mean.npy and Std.npy to have them computed",
              checks.error_detail(error, folder)[:120])
  return facts + checks.shared_captions(labels) + body.facts()
