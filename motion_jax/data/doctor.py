"""What is wrong with a data folder, and what to do about it: HumanML3D, SnapMoGen and BABEL folders, and archives."""
import collections
import dataclasses
import hashlib
import pathlib
import textwrap

import numpy as np
import tqdm

from motion_jax.data import checks, dataset_checks
from motion_jax.data.datasets import babel, humanml3d, snapmogen
from motion_jax.data.datasets.archive import FPS, is_archive, read_motions, read_row
from motion_jax.inputs.errors import InputError
from motion_jax.inputs.input_files import json_row
from motion_jax.inputs.text_files import read_lines
from motion_jax.motion.representations import layout_for, to_joints
from motion_jax.motion.skeleton import HUMANML3D

LEVELS = ("error", "warning", "note")
# Clips whose official features hold NaN.
KNOWN_BAD = ("007975", "M007975")


@dataclasses.dataclass(frozen=True)
class Finding:
  """One kind of fault: how bad, what, how often, where for example, what to do."""
  level: str
  what: str
  count: int
  examples: tuple[str, ...]
  advice: str


@dataclasses.dataclass(frozen=True)
class Report:
  """What `examine` found: facts (label, value) and findings, the worst first."""
  folder: str
  facts: tuple[tuple[str, str], ...]
  findings: tuple[Finding, ...]

  @property
  def ok(self) -> bool:
    """No errors; warnings and notes do not keep anybody from training."""
    return not any(finding.level == "error" for finding in self.findings)


def examine(folder, progress=False) -> Report:
  """Looks at every file of a data folder or an archive. Raises FileNotFoundError if folder is of no kind known here."""
  folder = pathlib.Path(folder)
  found = _Findings()
  if is_archive(folder):
    look = _examine_archive
  elif folder.is_dir() and ((folder / "new_joint_vecs").is_dir() or (folder / "new_joints").is_dir()):
    look = _examine_folder
  elif snapmogen.is_snapmogen(folder):
    look = dataset_checks.examine_snapmogen
  elif babel.is_babel(folder):
    look = dataset_checks.examine_babel
  else:
    raise FileNotFoundError(f"{folder} is no data folder: expected new_joint_vecs/ and texts/ (HumanML3D layout), "
                            "renamed_feats/ (SnapMoGen), motions/ and train.json (BABEL), or motions.npz and "
                            "captions.jsonl (archive); motion-jax data build makes one")
  with np.errstate(all="ignore"):  # numbers may be of any size here, and are told about
    facts = look(folder, found, progress)
  return Report(str(folder), tuple(facts), found.sorted())


def format_report(report) -> str:
  """A Report as a plain-text table."""
  lines = [f"{report.folder}"]
  width = max((len(label) for label, _ in report.facts), default=0)
  lines += [f"  {label:<{width}}  {value}" for label, value in report.facts] + [""]
  if report.findings:
    lines.append(f"{'level':<8} {'count':>6}  what")
  for finding in report.findings:
    examples = ", ".join(finding.examples) + (", ..." if finding.count > len(finding.examples) else "")
    lines += [f"{finding.level:<8} {finding.count:>6}  {finding.what}" + (f": {examples}" if finding.examples else "")]
    lines += textwrap.wrap(finding.advice, 100, initial_indent=" " * 17 + "-> ", subsequent_indent=" " * 20)
  counts = collections.Counter(finding.level for finding in report.findings)
  told = ", ".join(f"{counts[level]} {level}{'s' * (counts[level] != 1)}" for level in LEVELS if counts[level])
  state = "healthy" if report.ok else "not healthy: repair the errors before training"
  lines.append(state + (f" ({told})" if told else ""))
  return "\n".join(lines)


class _Findings:
  """Collects findings of one kind into one line."""

  def __init__(self):
    self.kinds = {}

  def add(self, level, what, advice, example=None, count=1):
    entry = self.kinds.setdefault((level, what, advice), [0, []])
    entry[0] += count
    if example is not None and len(entry[1]) < 3:
      entry[1].append(str(example))

  def add_all(self, level, what, advice, examples):
    for example in examples:
      self.add(level, what, advice, example)

  def sorted(self):
    findings = [Finding(level, what, count, tuple(examples), advice)
                for (level, what, advice), (count, examples) in self.kinds.items()]
    return tuple(sorted(findings, key=lambda finding: LEVELS.index(finding.level)))


def _examine_folder(folder, found, progress):
  for name in ("new_joint_vecs", "new_joints", "texts"):
    if not (folder / name).is_dir():
      found.add("error", f"no folder {name}", "copy it from the data set, or make it with motion-jax data build")
  stems = lambda name, suffix: {path.stem for path in (folder / name).glob(f"*{suffix}")}
  vectors, joints, texts = stems("new_joint_vecs", ".npy"), stems("new_joints", ".npy"), stems("texts", ".txt")
  splits = _splits(folder, found)
  listed = {name for ids in splits.values() for name in ids}
  found.add_all("error", "ids without a motion file", "loaders skip them silently: remove the ids from the split "
                "files, or restore new_joint_vecs/ID.npy", sorted(listed - vectors))
  found.add_all("error", "motions without a text file", "loaders skip them silently: write texts/ID.txt or remove the "
                "ids", sorted((listed & vectors) - texts))
  found.add_all("warning", "motions in no split", "add their ids to train.txt, val.txt or test.txt",
                sorted(vectors - listed))
  found.add_all("warning", "motions without joints", "make new_joints/ID.npy from the features "
                "(motion_jax.motion.representations.to_joints)", sorted(vectors - joints) if joints else ())
  found.add_all("warning", "mirrored clips without their original", "add the original, or remove the mirrored clip",
                sorted(name for name in vectors if name.startswith("M") and name[1:] not in vectors
                       and not (folder / "dataset.json").is_file()))
  if not vectors:
    found.add("error", "no motion in new_joint_vecs", "make the folder again")
    return [("format", "HumanML3D layout")]

  layout = _layout(folder, sorted(vectors), found)
  if layout is None:
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  try:
    info = humanml3d.dataset_info(folder)
  except ValueError as error:
    found.add("error", f"dataset.json cannot be used ({checks.told(error, folder / 'dataset.json')})",
              "build again, or remove it where the folder is HumanML3D's or KIT-ML's own")
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  body = checks.Body(found, layout.skeleton)
  rows, sums, hashes = [], humanml3d.RunningStats(layout), collections.defaultdict(list)
  for name in tqdm.tqdm(sorted(vectors), desc="clips", unit="clip", disable=not progress):
    features = checks.load(folder / "new_joint_vecs" / f"{name}.npy", found)
    if features is None:
      continue
    if features.ndim != 2 or features.shape[1] != layout.dim:
      found.add("error", f"features that are not (rows, {layout.dim})", "make them again; another representation got "
                "in", f"{name} {features.shape}")
      continue
    if not len(features):
      found.add("error", "clips of no rows", "remove their ids", name)
      continue
    if not np.isfinite(features).all():
      if name in KNOWN_BAD:
        found.add("error", "known bad clip of HumanML3D with NaN", "remove its id from all split files; it came so, "
                  "the papers leave it out", name)
      else:
        found.add("error", "features with NaN or infinity", "remove their ids, or repair the source and build again",
                  name)
      continue
    rows.append(len(features))
    sums.add(features)
    hashes[hashlib.sha1(features.tobytes()).hexdigest()].append(name)
    recovered = to_joints(features, layout)
    if name in joints:
      saved = checks.load(folder / "new_joints" / f"{name}.npy", found)
      if saved is not None:
        checks.compare_joints(saved, recovered, layout, name, found)
    body.check(name, recovered)
    if name in texts:
      checks.check_texts(folder / "texts" / f"{name}.txt", name, len(features) / info["fps"], found)
  body.tell()
  least = humanml3d.MIN_FRAMES[layout.skeleton.name]
  checks.tell_lengths(rows, least, found)
  checks.tell_duplicates(hashes, splits, found)
  if rows:
    checks.check_stats(folder, layout, sums.stats(), found)
  if abs(info["fps"] - layout.skeleton.fps) > 1e-6:
    found.add("warning", f"{info['fps']:g} frames a second, {layout.skeleton.name} has {layout.skeleton.fps:g}",
              "other tools take the usual rate for granted; build again with --resample")
  seconds = sum(rows) / info["fps"]
  return [("format", f"HumanML3D layout, {layout.name} features ({layout.dim}), {info['mode']} mode"),
          ("clips", f"{len(vectors)} ({sum(name.startswith('M') for name in vectors)} mirrored), "
           + ", ".join(f"{split} {len(ids)}" for split, ids in splits.items())),
          ("length", f"{sum(rows)} rows, {seconds / 3600:.2f} hours at {info['fps']:g} frames a second, "
           f"{min(rows, default=0)} to {max(rows, default=0)} rows a clip"),
          *body.facts()]


def _splits(folder, found):
  """Ids of train, val, test; tells of ids that occur twice, in two splits, or apart from their mirror image."""
  splits = {}
  for name in ("train", "val", "test"):
    if (folder / f"{name}.txt").is_file():
      splits[name] = humanml3d.read_ids(folder, name)
      twice = [one for one, count in collections.Counter(splits[name]).items() if count > 1]
      found.add_all("warning", f"ids twice in {name}.txt", "remove the second line", sorted(twice))
    else:
      found.add("error" if name == "train" else "warning", f"no {name}.txt", "write one id per line")
  where = collections.defaultdict(set)
  for split, ids in splits.items():
    for one in ids:
      where[one].add(split)
  leak = "results on test or val would be too good: keep each id in one split"
  found.add_all("error", "ids in two splits", leak, sorted(one for one, names in where.items() if len(names) > 1))
  apart = [one for one in where if "M" + one in where and where[one] != where["M" + one]]
  found.add_all("error", "clips in another split than their mirror image", leak, sorted(apart))
  alone = sum("M" + one not in where for one in where if not one.startswith("M"))
  if alone:
    found.add("note", "clips without a mirrored copy", "fine; motion-jax data build adds them unless told otherwise",
              count=alone)
  for derived, parts in (("train_val", ("train", "val")), ("all", ("train", "val", "test"))):
    if (folder / f"{derived}.txt").is_file():
      expected = {one for part in parts for one in splits.get(part, ())}
      if set(humanml3d.read_ids(folder, derived)) != expected:
        found.add("warning", f"{derived}.txt is not the union of {', '.join(parts)}", "write it again")
  return splits


def _layout(folder, names, found):
  """The layout of the folder by the width of most of its files."""
  widths = collections.Counter()
  for name in names[:50]:
    features = checks.load(folder / "new_joint_vecs" / f"{name}.npy", None)
    if features is not None and features.ndim == 2:
      widths[features.shape[1]] += 1
  try:
    return layout_for(widths.most_common(1)[0][0])
  except (IndexError, ValueError) as error:
    found.add("error", f"unknown features: {error}", "expected HumanML3D's 263 or KIT's 251 numbers a row")
    return None


def _examine_archive(folder, found, progress):
  facts = [("format", "archive (motions.npz, captions.jsonl)")]
  try:
    motions = read_motions(folder)
  except (InputError, OSError) as error:
    found.add("error", f"motions.npz: {checks.told(error, folder / 'motions.npz')}",
              "copy it again, or write it with names (N,), start (N + 1,), root (frames, 3), local (frames, 22, 3)")
    return facts
  names = list(motions.spans)
  body, hashes = checks.Body(found, HUMANML3D, canonical=False), collections.defaultdict(list)
  for name in tqdm.tqdm(names, desc="clips", unit="clip", disable=not progress):
    joints = motions.joints(name)
    if not len(joints):
      found.add("error", "clips of no frames", "remove them", name)
    elif not np.isfinite(joints).all():
      found.add("error", "clips with NaN or infinity", "remove them, or repair the source", name)
    else:
      hashes[hashlib.sha1(joints.tobytes()).hexdigest()].append(name)
      if len(joints) > 1:
        body.check(name, joints)
  body.tell()
  rows, where = _check_rows(folder / "captions.jsonl", motions, found)
  splits = {split: [clip for clip, own in where.items() if split in own] for split in ("train", "val", "test")}
  checks.tell_duplicates(hashes, splits, found)
  found.add_all("warning", "clips without a caption", "write rows for them in captions.jsonl",
                sorted(set(names) - set(where)))
  counts = collections.Counter(row.get("split") for row in rows)
  hours = len(motions.root) / FPS / 3600
  return facts + [("clips", f"{len(names)}, {len(motions.root)} frames, {hours:.2f} hours at {FPS:g} frames a second"),
                  ("pieces", f"{len(rows)}, " + ", ".join(f"{split} {count}" for split, count in counts.items())),
                  *body.facts()]


_ROW_FAULTS = (("is not in motions.npz", "captions of clips that are not there"),
               ("lie outside", "captions of frames outside their clip"))


def _check_rows(path, motions, found):
  """Rows of captions.jsonl that can be used, and the splits of each clip."""
  rows, where, seen = [], collections.defaultdict(set), set()
  try:
    lines = read_lines(path)
  except InputError as error:
    found.add("error", f"captions.jsonl: {checks.told(error, path)}", "save it as UTF-8 text")
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
      found.add("error", what, "each is a JSON object with id, clip, start, end, text, split; correct or remove it",
                checks.told(error, path)[:120])
      continue
    rows.append(row)
    name = row["clip"]
    if not any(text.strip() for text in row["text"]):
      found.add("error", "rows without a caption", "write one, or remove the row", f"line {number} ({name})")
    if row["id"] in seen:
      found.add("error", "ids that occur twice", "name them differently", row["id"])
    seen.add(row["id"])
    where[name].add(row["split"])
    if row["split"] not in ("train", "val", "test"):
      found.add("error", "rows in no split", "split is train, val or test", f"line {number} ({row['split']!r})")
    if row.get("spikes"):
      found.add("note", "pieces with tracking faults (spikes)", "leave them out of training if few", row["id"])
  found.add_all("error", "clips with pieces in two splits", "results on test or val would be too good: keep a clip in "
                "one split", sorted(name for name, own in where.items() if len(own) > 1))
  return rows, where
