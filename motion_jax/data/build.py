"""Build a HumanML3D-layout folder from an archive, or from motion-capture files and a table of captions."""
import collections
import hashlib
import math
import pathlib
import shlex

import numpy as np
import tqdm

from motion_jax.data import merged_warnings
from motion_jax.data.clip import Caption
from motion_jax.data.datasets import humanml3d
from motion_jax.data.datasets.registry import find_dataset
from motion_jax.data.mocap.files import READERS, none_read, read_clip, read_mapping
from motion_jax.utils import text_files
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import json_row
from motion_jax.utils.numerals import SECONDS, NumberError, named, real

LONGEST = 200  # frames; the field's loaders omit longer clips
_COLUMNS = ("file", "caption", "start", "end", "split", "source", "license")
_SECONDS = real(*SECONDS, unit="seconds")
_ENOUGH = 5  # number of recordings from which on each split gets at least one
_SPLITS = (("train", 0.80), ("val", 0.85), ("test", 1.0))  # HumanML3D's shares


def build(source, out, captions=None, mapping=None, mode="corrected", mirror=True, fps=None, overwrite=False,
          progress=True, source_fps=None, faults=None) -> str:
  """Builds folder `out` from a source and returns a summary to print.

  source: a data folder, such as an archive (motions.npz, captions.jsonl), or a folder of BVH or AMC files (in
  sub-folders too) with a table of captions (CSV, TSV, JSONL; None: captions.* in the source). mapping: a table's
  name, a JSON file or a dict {our joint: theirs}. fps: of the folder (20); source_fps: frame rate of the captured
  files, replacing the one that they state (.amc files state none: 120). Clips of more than 200 frames are cut into
  equal pieces; clips without a split get one from a hash of their name, 80 % train, 5 % val, 15 % test. faults: a list
  to which (file, fault) of unreadable captured files is appended; these are omitted; without it the first is raised.
  `out` is created only if everything succeeds.
  """
  source = pathlib.Path(source)
  if not source.is_dir():
    raise FileNotFoundError(f"there is no folder {source}; expected an archive or a folder of "
                            f"{', '.join(READERS)} files")
  if pathlib.Path(out).exists() and not overwrite:
    raise FileExistsError(f"{out} exists already; choose another name, or say overwrite")
  dataset = find_dataset(source)
  if dataset is not None:
    clips, left_out = dataset.clips(source), []
  else:
    with merged_warnings.merged():
      clips, left_out = read_captures(source, captions, mapping, fps or 20.0, progress, source_fps, faults)
  if not clips and faults:
    raise InputError(none_read(source, faults))
  if not clips:
    raise InputError(f"{source} gives no clip")
  clips = with_splits(with_own_ids([piece for clip in with_own_ids(clips, mirror) for piece in pieces(clip)], mirror))
  info = humanml3d.write_folder(clips, out, mode, mirror, fps, overwrite, progress)
  return summary(out, info, left_out)


def read_captures(folder, captions=None, mapping=None, fps=20.0, progress=False, source_fps=None, faults=None):
  """(clips of the captured files that the table of captions names, files that it does not name)."""
  folder = pathlib.Path(folder)
  files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*"))
           if path.suffix.lower() in READERS}
  if not files:
    raise FileNotFoundError(f"{folder} is no archive (motions.npz, captions.jsonl) and holds no "
                            f"{' or '.join(READERS)} file")
  table = read_captions(captions or _find_captions(folder))
  stems = collections.defaultdict(list)
  for name in files:
    stems[name.rsplit(".", 1)[0]].append(name)
  rows, unknown, named_clips = {}, [], set()
  for row in table:
    key = row["file"].replace("\\", "/").removeprefix("./")
    if "#" in key and key not in files and (file := key.rpartition("#")[0]) in files:  # one clip of several in a file
      files[key] = files[file].with_name(f"{files[file].name}#{key.rpartition('#')[2]}")
      named_clips.add(file)
    matches = [key] if key in files else stems.get(key, ())
    if len(matches) > 1:
      raise InputError(f"the captions name {key!r}, which may be {named(matches)}; give the file's whole name")
    if matches:
      rows.setdefault(matches[0], []).append(row)
    else:
      unknown.append(row["file"])
  if there := [name for name in unknown if (folder / name).is_file()]:
    stem = pathlib.Path(there[0]).stem
    raise InputError(f"the captions of {folder} name {named(there, 3)}, and data build reads {' or '.join(READERS)}; "
                     f"motion-jax render {shlex.quote(there[0])} --out {shlex.quote(stem)}.bvh makes one of them")
  if unknown:
    raise InputError(f"the captions name files that {folder} lacks: {named(unknown, 3)}; it has "
                     f"{named(files, 3)}")
  mapping = read_mapping(mapping)
  clips = []
  for name, captions_of_file in tqdm.tqdm(rows.items(), desc="files", unit="file", disable=not progress):
    splits = {row["split"] for row in captions_of_file if row["split"]}
    if len(splits) > 1:
      raise InputError(f"the captions put {name} into the splits {named(sorted(splits), 5)}; expected one")
    first = captions_of_file[0]
    clip = read_clip(
        files[name], name, faults, mapping=mapping, fps=fps, source_fps=source_fps, id=_id(name), split="".join(splits),
        captions=tuple(Caption(row["caption"], row["start"], row["end"]) for row in captions_of_file),
        source=first["source"] or folder.resolve().name, license=first["license"])
    if clip is not None and clip.num_frames < 2:
      short = f"it has {clip.num_frames} frame at {fps:g} frames a second, expected 2 or more"
      if faults is None:
        raise InputError(f"{files[name]}: {short}; leave it out of the captions")
      faults.append((name, short))
    elif clip is not None:
      clips.append(clip)
  return clips, sorted(set(files) - set(rows) - named_clips)


def read_captions(path) -> list[dict]:
  """Rows of a CSV, TSV or JSONL table with the columns file and caption, and, if wanted, start and end (seconds),
  split, source, license. Raises ValueError with the line."""
  path = pathlib.Path(path)
  suffix = path.suffix.lower()
  if suffix == ".jsonl":
    lines = text_files.read_lines(path, "captions file")
    raw = [(number, json_row(line, path, number)) for number, line in enumerate(lines, 1) if line.strip()]
  elif suffix in (".csv", ".tsv"):
    header, *rows = text_files.read_table(path, _has_columns, "captions file") or [text_files.Row(1, [])]
    names = [name.lower() for name in header.cells]
    if not _has_columns([header]):
      raise InputError(f"{path} line {header.line}: got the columns {named(names, 10) or 'none'}, expected "
                       f"{', '.join(_COLUMNS[:2])} and perhaps {', '.join(_COLUMNS[2:])}")
    raw = [(row.line, dict(zip(names, row.cells + [""] * len(names)))) for row in rows]
  else:
    raise InputError(f"got captions in {path.name}, expected a .csv, .tsv or .jsonl file with the columns "
                     f"{', '.join(_COLUMNS[:2])} and perhaps {', '.join(_COLUMNS[2:])}")
  rows = []
  for number, row in raw:
    row = {key.strip().lower(): value for key, value in row.items()}
    if not str(row.get("file") or "").strip() or not str(row.get("caption") or "").strip():
      raise InputError(f"{path} line {number}: no file or no caption; the columns are {named(row, 10)}, expected "
                       f"{', '.join(_COLUMNS[:2])} and perhaps {', '.join(_COLUMNS[2:])}")
    try:
      # Where columns are parted by semicolons, Excel writes decimals with a comma.
      times = {key: _SECONDS(str(row.get(key) or 0).replace(",", ".")) for key in ("start", "end")}
    except NumberError as error:
      raise InputError(f"{path} line {number}: in start or end: {error}") from None
    if times["start"] < 0 or (any(times.values()) and not times["start"] < times["end"]):
      raise InputError(f"{path} line {number}: the span {times['start']} to {times['end']} s is empty")
    rows.append({key: str(row.get(key) or "").strip() for key in _COLUMNS} | times)
  return rows


def with_own_ids(clips, mirror=True):
  """Makes ids unique, mirrored copies included, by suffixes _2, _3, ..."""
  taken, result = set(), []
  for clip in clips:
    id, number = clip.id, 1
    while taken & {id, *(["M" + id] if mirror else [])}:
      number += 1
      id = f"{clip.id}_{number}"
    taken |= {id, *(["M" + id] if mirror else [])}
    result.append(clip.replace(id=id))
  return result


def pieces(clip, longest=LONGEST):
  """A clip, or equal pieces of at most `longest` frames; a piece keeps timed captions that overlap it by a second."""
  num = math.ceil(clip.num_frames / longest)
  if num == 1:
    return [clip]
  cuts = np.linspace(0, clip.num_frames, num + 1).astype(int)
  result = []
  for index, (first, last) in enumerate(zip(cuts[:-1], cuts[1:])):
    captions = []
    for caption in clip.captions:
      if not caption.start and not caption.end:
        captions.append(caption)
        continue
      start, end = max(caption.start - first / clip.fps, 0), min(caption.end, last / clip.fps) - first / clip.fps
      if end - start >= 1:
        captions.append(Caption(caption.text, round(start, 3), round(end, 3)))
    if captions or not clip.captions:
      result.append(clip.replace(joints=clip.joints[first:last], id=f"{clip.id}_{index:02d}", captions=tuple(captions),
                                 meta=clip.meta | {"of": clip.id}))
  return result


def with_splits(clips):
  """Assigns a split to clips without one, by a hash of the name of the whole clip: its pieces stay together."""
  def split_of(clip):
    digest = hashlib.sha256(_recording(clip).encode()).digest()
    place = int.from_bytes(digest[:8], "big") / 2**64
    return next(name for name, end in _SPLITS if place < end)
  chosen = [clip.split or split_of(clip) for clip in clips]
  if "train" not in chosen:  # the hash may leave train empty for a handful of clips
    chosen = [clip.split or "train" for clip in clips]
  names = sorted({_recording(clip) for clip in clips}, key=lambda name: hashlib.sha256(name.encode()).digest())
  if len(names) >= _ENOUGH and not any(clip.split for clip in clips):
    # The hash may leave val or test empty for a few dozen clips.
    for split in ("val", "test"):
      if split not in chosen:
        of_train = [name for name in names if all(
            was == "train" for clip, was in zip(clips, chosen) if _recording(clip) == name)]
        chosen = [split if _recording(clip) == of_train[0] else was for clip, was in zip(clips, chosen)]
  return [clip.replace(split=split) for clip, split in zip(clips, chosen)]


def _recording(clip):
  """The name of the whole clip that this one is a piece of."""
  return clip.meta.get("of", clip.id)


def summary(out, info, left_out=()) -> str:
  """A printable summary of the written folder."""
  seconds = info["num_frames"] / info["fps"]
  lines = [f"{out}: {info['num_clips']} clips, {info['num_frames']} frames, {seconds / 3600:.2f} hours at "
           f"{info['fps']:g} frames a second, {info['layout']} features, {info['mode']} mode",
           "  " + ", ".join(f"{split} {count}" for split, count in info["splits"].items()) +
           f"; {info['shortest']} to {info['longest']} rows a clip"]
  lines += [f"  {name or 'no source given'}: {entry['clips']} clips, licence {entry['license'] or 'not given'}"
            for name, entry in info["sources"].items()]
  if left_out:
    lines.append(f"  left out, as no caption names them: {len(left_out)} files ({', '.join(left_out[:3])})")
  return "\n".join(lines)


def _find_captions(folder):
  for suffix in (".csv", ".tsv", ".jsonl"):
    if (folder / f"captions{suffix}").is_file():
      return folder / f"captions{suffix}"
  raise FileNotFoundError(f"{folder} has no captions.csv, .tsv or .jsonl with the columns file, caption and perhaps "
                          f"start, end, split; motion-jax data describe {shlex.quote(str(folder))} "
                          f"--out {shlex.quote(str(folder / 'captions.csv'))} describes the motions by their joints")


def _id(name):
  """A file's path inside its folder as an id."""
  return "_".join("_".join(name.rsplit(".", 1)[0].split("/")).split())


def _has_columns(rows):
  return bool(rows) and set(_COLUMNS[:2]) <= {name.lower() for name in rows[0].cells}
