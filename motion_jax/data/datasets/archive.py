"""Archives: one `motions.npz` with the joints of many clips and one `captions.jsonl` with sentences about them.

motions.npz: names (N,), start (N + 1,) frame offsets, root (frames, 3) metres, local (frames, 22, 3) joints less the
pelvis; 20 frames a second, 22 joints in HumanML3D's order. captions.jsonl, a row per piece of a clip: id, clip, start,
end (frames in the clip), text (a list of sentences, or one), split, and optionally content, style, label, spans (a list
of (sentence, first frame, frame past the last) of parts), made (how the application made the clip) and optimality (of a
scored sample, `diffusion.negative_aware`).
"""
import collections
import hashlib
import pathlib
from typing import NamedTuple

import numpy as np
import tqdm

from motion_jax.data import checks
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset
from motion_jax.motion import plausibility
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax.utils.format_versions import KEY, check_version
from motion_jax.utils.input_files import json_row, load_npz, read_json, read_json_lines
from motion_jax.utils.text_files import read_lines

FPS = 20.0
_CMU = "CMU: free for all uses, not to be resold; mocap.cs.cmu.edu, funded by NSF EIA-0196217"
_LICENSES = {"cmu": _CMU, "cmu2": _CMU, "bandai": "CC BY-NC 4.0, (c) 2022 Bandai Namco Research Inc.",
             "hdm05": "CC BY-SA 3.0, Mocap Database HDM05, Hochschule der Medien Stuttgart and University of Bonn",
             "reactidle": "MIT, (c) 2025 RSAIT", "mimic": "MIT, (c) 2018 Xue Bin Peng, (c) Meta Platforms, Inc.",
             "gameclips": "CC0 1.0", "kaykit": "CC0 1.0, Kay Lousberg, www.kaylousberg.com"}
_TAGS = ("clip", "content", "style", "label", "subject", "whole", "spikes", "made", "spans", "optimality")
ABOUT = "archive.json"  # optional: {"license": ...} of archives that are not in _LICENSES


def is_archive(folder) -> bool:
  return all((pathlib.Path(folder) / name).is_file() for name in ("motions.npz", "captions.jsonl"))


def read_archive(folder, split=None, faults=None) -> list[Clip]:
  """Reads the captioned pieces of an archive as Clips, in the order of the captions; split: only this one.

  faults: a list to which (id, fault) of pieces with NaN or implausible skeletons is appended; these are omitted. Raises
  FileNotFoundError for a missing file, InputError with the line for rows that lack a key, name no clip or frames
  outside it, and, without faults, for a faulty piece.
  """
  arrays, path = read_motions(folder), pathlib.Path(folder) / "captions.jsonl"
  clips, name = [], path.parent.name
  about = read_json(path.with_name(ABOUT)) if path.with_name(ABOUT).is_file() else {}
  check_version(about.get(KEY, 1), f"the archive {path.parent}")
  license_text = about.get("license") or _LICENSES.get(name, "")
  for number, row in read_json_lines(path):
    row = read_row(row, arrays, f"{path} line {number}")
    if split and row["split"] != split:
      continue
    joints = arrays.joints(row["clip"], row["start"], row["end"])
    fault = plausibility.fault(joints, fps=FPS, name=f"{path} line {number}: clip {row['clip']!r}")
    if fault and faults is None:
      raise InputError(fault)
    if fault:
      faults.append((row["id"], "joints that are no person's" if np.isfinite(joints).all() else "NaN"))
      continue
    clips.append(Clip(
        joints=joints, fps=FPS, captions=tuple(Caption(text) for text in row["text"]), id=row["id"],
        split=row["split"], source=name, license=license_text,
        meta={tag: row[tag] for tag in _TAGS if tag in row} | ({"num_own": 0} if "made" in row else {})))
  return clips


class Motions(NamedTuple):
  """motions.npz: spans {clip: (first frame, frame after the last)}; root (N, 3), local (N, 22, 3)."""
  spans: dict[str, tuple[int, int]]
  root: np.ndarray
  local: np.ndarray

  def length(self, name) -> int:
    return self.spans[name][1] - self.spans[name][0]

  def joints(self, name, start=0, end=None):
    """Frames start:end of a clip, (T, 22, 3) float32."""
    first, past = self.spans[name]
    piece = slice(first + start, past if end is None else first + end)
    with np.errstate(over="ignore", invalid="ignore"):  # the caller checks for infinity
      return self.root[piece, None].astype(np.float32) + self.local[piece].astype(np.float32)


def read_motions(folder) -> Motions:
  """Reads motions.npz of an archive. Raises FileNotFoundError, or InputError for damaged or inconsistent arrays."""
  folder = pathlib.Path(folder)
  if not is_archive(folder):
    raise FileNotFoundError(f"{folder} is no archive: expected motions.npz and captions.jsonl in it")
  path = folder / "motions.npz"
  arrays = load_npz(path, ("start", "root", "local"), ("names",), required=("names", "start", "root", "local"))
  names, start, root, local = (arrays[key] for key in ("names", "start", "root", "local"))
  if names.ndim != 1 or start.shape != (len(names) + 1,) or root.ndim != 2 or root.shape[1] != 3 or (
      local.shape != (len(root), HUMANML3D.num_joints, 3)):
    raise InputError(f"{path}: arrays do not fit together: names {names.shape}, start {start.shape}, root "
                     f"{root.shape}, local {local.shape}; expected (N,), (N + 1,), (frames, 3), (frames, 22, 3)")
  borders = start.astype(np.float64)
  if not np.isfinite(borders).all() or borders[0] != 0 or borders[-1] != len(root) or (np.diff(borders) < 0).any() or (
      borders % 1).any():
    raise InputError(f"{path}: arrays do not fit together: start should rise from 0 to {len(root)}, the frames that "
                     "there are; copy the archive again")
  names = [name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name) for name in names.tolist()]
  if len(set(names)) < len(names):
    twice = next(name for name, count in collections.Counter(names).items() if count > 1)
    raise InputError(f"{path}: the name {twice[:60]!r} occurs twice")
  borders = borders.astype(int).tolist()
  return Motions(dict(zip(names, zip(borders[:-1], borders[1:]))), root, local)


def read_row(row, motions, where) -> dict:
  """Checks a row of captions.jsonl; a single text becomes a list.

  Raises InputError, beginning with `where`, for missing keys, wrong types, and clips or frames that do not exist.
  """
  missing = [key for key in ("id", "clip", "start", "end", "text", "split") if key not in row]
  if missing:
    raise InputError(f"{where}: the row lacks {', '.join(missing)}; expected id, clip, start, end, text and split")
  row = row | {"text": [row["text"]] if isinstance(row["text"], str) else row["text"]}
  for key, kind, called in (("id", str, "text"), ("clip", str, "text"), ("split", str, "text"),
                            ("start", int, "a whole number"), ("end", int, "a whole number"),
                            ("text", list, "a sentence or a list of them")):
    if not isinstance(row[key], kind) or isinstance(row[key], bool) or key == "text" and not all(
        isinstance(text, str) for text in row["text"]):
      raise InputError(f"{where}: got {key} {str(row[key])[:60]!r}, expected {called}")
  if not all(isinstance(span, list) and list(map(type, span)) == [str, int, int] for span in row.get("spans", ())):
    raise InputError(f"{where}: got spans {str(row['spans'])[:60]}, expected a list of [sentence, first, past]")
  if row["clip"] not in motions.spans:
    raise InputError(f"{where}: clip {row['clip'][:60]!r} is not in motions.npz")
  length = motions.length(row["clip"])
  if not 0 <= row["start"] < row["end"] <= length:
    raise InputError(f"{where}: frames {row['start']}:{row['end']} lie outside clip {row['clip'][:60]!r} of {length} "
                     "frames")
  return row


class Archive(Dataset):
  """Folders of motions.npz and captions.jsonl."""
  name, holds = "archive", "archive (motions.npz, captions.jsonl)"
  files = ("motions.npz", "captions.jsonl")

  def matches(self, folder):
    return is_archive(folder)

  def clips(self, folder, split=None, faults=None):
    return read_archive(folder, split, faults)

  def configure(self, data, folder):
    data.update(name=self.name, folder="", folders=(folder,))
    return ""

  def fingerprint(self, folder):
    """Digest of the bytes of an archive and of its name, which is the source of its clips."""
    folder = pathlib.Path(folder)
    digest = hashlib.sha256(folder.resolve().name.encode())
    for name in self.files:
      with open(folder / name, "rb") as file:
        digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()

  def benchmark(self, folders, run_layout):
    return "archives-66"

  def examine(self, folder, tally, progress=False):
    return _examine(pathlib.Path(folder), tally, progress)


# --- checks of the doctor --------------------------------------------------------------------------------------------


def _examine(folder, tally, progress):
  facts = [("format", "archive (motions.npz, captions.jsonl)")]
  try:
    motions = read_motions(folder)
  except (InputError, OSError) as error:
    tally.add("error", f"motions.npz: {checks.error_detail(error, folder / 'motions.npz')}",
              "copy it again, or write it with names (N,), start (N + 1,), root (frames, 3), local (frames, 22, 3)")
    return facts
  names = list(motions.spans)
  body, hashes = checks.Body(tally, HUMANML3D, canonical=False), collections.defaultdict(list)
  for name in tqdm.tqdm(names, desc="clips", unit="clip", disable=not progress):
    joints = motions.joints(name)
    if not len(joints):
      tally.add("error", "clips of no frames", "remove them", name)
    elif not np.isfinite(joints).all():
      tally.add("error", "clips with NaN or infinity", "remove them, or repair the source", name)
    else:
      hashes[hashlib.sha1(joints.tobytes()).hexdigest()].append(name)
      if len(joints) > 1:
        body.check(name, joints)
  body.report()
  rows, where = _check_rows(folder / "captions.jsonl", motions, tally)
  splits = {split: [clip for clip, used in where.items() if split in used] for split in ("train", "val", "test")}
  checks.report_duplicates(hashes, splits, tally)
  tally.add_all("warning", "clips without a caption", "write rows for them in captions.jsonl",
                sorted(set(names) - set(where)))
  lengths = {row["id"]: row["end"] - row["start"] for row in rows}
  checks.report_lengths(lengths, {split: [row["id"] for row in rows if row["split"] == split] for split in splits},
                      checks.SMALL_LEAST, tally)
  counts = collections.Counter(row.get("split") for row in rows)
  captions = {split: [text for row in rows if row["split"] == split for text in row["text"]] for split in splits}
  hours = len(motions.root) / FPS / 3600
  return facts + [("clips", f"{len(names)}, {len(motions.root)} frames, {hours:.2f} hours at {FPS:g} frames a second"),
                  ("pieces", f"{len(rows)}, " + ", ".join(f"{split} {count}" for split, count in counts.items())),
                  *checks.shared_captions(captions), *body.facts()]


_ROW_FAULTS = (("is not in motions.npz", "captions of clips that are not there"),
               ("lie outside", "captions of frames outside their clip"))


def _check_rows(path, motions, tally):
  """(valid rows of captions.jsonl, {clip: its splits})."""
  rows, where, seen = [], collections.defaultdict(set), set()
  try:
    lines = read_lines(path)
  except InputError as error:
    tally.add("error", f"captions.jsonl: {checks.error_detail(error, path)}", "save it as UTF-8 text")
    return rows, where
  for number, line in enumerate(lines, 1):
    if not line.strip():
      continue
    try:
      row = json_row(line, path, number)
      row = read_row(row, motions, f"{path} line {number}")
    except InputError as error:
      what = next((what for words, what in _ROW_FAULTS if words in str(error)), "rows of captions.jsonl that cannot be "
                  "read")
      tally.add("error", what, "each is a JSON object with id, clip, start, end, text, split; correct or remove it",
                checks.error_detail(error, path)[:120])
      continue
    rows.append(row)
    name = row["clip"]
    if not any(text.strip() for text in row["text"]):
      tally.add("error", "rows without a caption", "write one, or remove the row", f"line {number} ({name})")
    if row["id"] in seen:
      tally.add("error", "ids that occur twice", "name them differently", row["id"])
    seen.add(row["id"])
    where[name].add(row["split"])
    if row["split"] not in ("train", "val", "test"):
      tally.add("error", "rows in no split", "split is train, val or test", f"line {number} ({row['split']!r})")
    if row.get("spikes"):
      tally.add("note", "pieces with tracking faults (spikes)", "leave them out of training if few", row["id"])
  tally.add_all("error", "clips with pieces in two splits", "results on test or val would be too good: keep a clip in "
                "one split", sorted(name for name, splits in where.items() if len(splits) > 1))
  return rows, where
