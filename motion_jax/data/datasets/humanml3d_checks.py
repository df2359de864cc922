"""The checks of `motion-jax data doctor` for folders of HumanML3D's layout."""
import collections
import hashlib

import numpy as np
import tqdm

from motion_jax.data import checks
from motion_jax.data.datasets import humanml3d_files
from motion_jax.data.datasets.caption_lines import read_texts
from motion_jax.motion.representations import layout_for, to_joints
from motion_jax.motion.stats import RunningStats

# Clips whose official features contain NaN.
KNOWN_BAD = ("007975", "M007975")


def examine(folder, tally, progress):
  """Checks a folder's clips, splits, lengths, statistics, texts and the bodies of its features.

  Faults are added to `tally`; returns the facts to print, [(name, text), ...].
  """
  for name in ("new_joint_vecs", "new_joints", "texts"):
    if not (folder / name).is_dir():
      tally.add("error", f"no folder {name}", "copy it from the data set, or make it with motion-jax data build")
  stems = lambda name, suffix: {path.stem for path in (folder / name).glob(f"*{suffix}")}
  vectors, joints, texts = stems("new_joint_vecs", ".npy"), stems("new_joints", ".npy"), stems("texts", ".txt")
  splits = _splits(folder, tally)
  _report_missing(folder, splits, vectors, joints, texts, tally)
  if not vectors:
    tally.add("error", "no motion in new_joint_vecs", "make the folder again")
    return [("format", "HumanML3D layout")]

  layout = _layout(folder, sorted(vectors), tally)
  if layout is None:
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  try:
    info = humanml3d_files.dataset_info(folder)
  except ValueError as error:
    tally.add("error", f"dataset.json cannot be used ({checks.error_detail(error, folder / 'dataset.json')})",
              "build again, or remove it where the folder is HumanML3D's or KIT-ML's own")
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  body = checks.Body(tally, layout.skeleton)
  rows, captions, sums, hashes = {}, {}, RunningStats(layout), collections.defaultdict(list)
  for name in tqdm.tqdm(sorted(vectors), desc="clips", unit="clip", disable=not progress):
    features = _usable_features(folder, name, layout, tally)
    if features is None:
      continue
    rows[name] = len(features)
    sums.add(features)
    hashes[hashlib.sha1(features.tobytes()).hexdigest()].append(name)
    recovered = to_joints(features, layout)
    if name in joints:
      saved = checks.load(folder / "new_joints" / f"{name}.npy", tally)
      if saved is not None:
        checks.compare_joints(saved, recovered, layout, name, tally)
    body.check(name, recovered)
    if name in texts:
      captions[name] = _check_texts(folder / "texts" / f"{name}.txt", name, len(features) / info["fps"], tally)
  body.report()
  least = humanml3d_files.MIN_FRAMES[layout.skeleton.name]
  checks.report_lengths(rows, splits, least, tally)
  checks.report_duplicates(hashes, splits, tally)
  if rows:
    checks.check_stats(folder, layout, sums.stats(), tally)
  if abs(info["fps"] - layout.skeleton.fps) > 1e-6:
    tally.add("warning", f"{info['fps']:g} frames a second, {layout.skeleton.name} has {layout.skeleton.fps:g}",
              "other tools take the usual rate for granted; build again with --resample")
  seconds = sum(rows.values()) / info["fps"]
  return [("format", f"HumanML3D layout, {layout.name} features ({layout.dim}), {info['mode']} mode"),
          ("clips", f"{len(vectors)} ({sum(name.startswith('M') for name in vectors)} mirrored), "
           + ", ".join(f"{split} {len(ids)}" for split, ids in splits.items())),
          ("length", f"{sum(rows.values())} rows, {seconds / 3600:.2f} hours at {info['fps']:g} frames a second, "
           f"{min(rows.values(), default=0)} to {max(rows.values(), default=0)} rows a clip"),
          *checks.shared_captions({split: [text for clip_id in ids for text in captions.get(clip_id, ())]
                                   for split, ids in splits.items()}), *body.facts()]


def _report_missing(folder, splits, vectors, joints, texts, tally):
  """Reports ids of splits without files, and files without others of their clip or an id."""
  listed = {name for ids in splits.values() for name in ids}
  tally.add_all("error", "ids without a motion file", "loaders skip them silently: remove the ids from the split "
                "files, or restore new_joint_vecs/ID.npy", sorted(listed - vectors))
  tally.add_all("error", "motions without a text file", "loaders skip them silently: write texts/ID.txt or remove the "
                "ids", sorted((listed & vectors) - texts))
  tally.add_all("warning", "motions in no split", "add their ids to train.txt, val.txt or test.txt",
                sorted(vectors - listed))
  tally.add_all("warning", "motions without joints", "make new_joints/ID.npy from the features "
                "(motion_jax.motion.representations.to_joints)", sorted(vectors - joints) if joints else ())
  tally.add_all("warning", "mirrored clips without their original", "add the original, or remove the mirrored clip",
                sorted(name for name in vectors if name.startswith("M") and name[1:] not in vectors
                       and not (folder / "dataset.json").is_file()))


def _usable_features(folder, name, layout, tally):
  """Features of a clip; None, and a finding, for those that cannot be used."""
  features = checks.load(folder / "new_joint_vecs" / f"{name}.npy", tally)
  if features is None:
    return None
  if features.ndim != 2 or features.shape[1] != layout.dim:
    tally.add("error", f"features that are not (rows, {layout.dim})", "make them again; another representation got in",
              f"{name} {features.shape}")
  elif not len(features):
    tally.add("error", "clips of no rows", "remove their ids", name)
  elif not np.isfinite(features).all() and name in KNOWN_BAD:
    tally.add("error", "known bad clip of HumanML3D with NaN", "remove its id from all split files; it came so, the "
              "papers leave it out", name)
  elif not np.isfinite(features).all():
    tally.add("error", "features with NaN or infinity", "remove their ids, or repair the source and build again", name)
  else:
    return features
  return None


def _splits(folder, tally):
  """Ids of train, val and test; reports ids that occur twice, in two splits, or apart from their mirror image."""
  splits = {}
  for name in ("train", "val", "test"):
    if (folder / f"{name}.txt").is_file():
      splits[name] = humanml3d_files.read_ids(folder, name)
      twice = [clip_id for clip_id, count in collections.Counter(splits[name]).items() if count > 1]
      tally.add_all("warning", f"ids twice in {name}.txt", "remove the second line", sorted(twice))
    else:
      tally.add("error" if name == "train" else "warning", f"no {name}.txt", "write one id per line")
  where = collections.defaultdict(set)
  for split, ids in splits.items():
    for clip_id in ids:
      where[clip_id].add(split)
  leak = "results on test or val would be too good: keep each id in one split"
  tally.add_all("error", "ids in two splits", leak, sorted(name for name, used in where.items() if len(used) > 1))
  apart = [clip_id for clip_id in where if "M" + clip_id in where and where[clip_id] != where["M" + clip_id]]
  tally.add_all("error", "clips in another split than their mirror image", leak, sorted(apart))
  alone = sum("M" + clip_id not in where for clip_id in where if not clip_id.startswith("M"))
  if alone:
    tally.add("note", "clips without a mirrored copy", "fine; motion-jax data build adds them, except with --no-mirror",
              count=alone)
  for derived, parts in (("train_val", ("train", "val")), ("all", ("train", "val", "test"))):
    if (folder / f"{derived}.txt").is_file():
      expected = {clip_id for part in parts for clip_id in splits.get(part, ())}
      if set(humanml3d_files.read_ids(folder, derived)) != expected:
        tally.add("warning", f"{derived}.txt is not the union of {', '.join(parts)}", "write it again")
  return splits


def _layout(folder, names, tally):
  """The layout of the folder by the width of most of its files."""
  widths = collections.Counter()
  for name in names[:50]:
    features = checks.load(folder / "new_joint_vecs" / f"{name}.npy", None)
    if features is not None and features.ndim == 2:
      widths[features.shape[1]] += 1
  try:
    return layout_for(widths.most_common(1)[0][0])
  except (IndexError, ValueError) as error:
    tally.add("error", f"unknown features: {error}", "expected HumanML3D's 263 or KIT's 251 numbers a row")
    return None


def _check_texts(path, name, seconds, tally):
  """The captions of a clip; their faults are added to `tally`."""
  try:
    lines = read_texts(path)
  except ValueError as error:
    tally.add("error", "text files that cannot be read", "each line is caption#tokens#start#end",
              f"{name} ({checks.error_detail(error, path)})"[:120])
    return []
  if not any(line.caption for line in lines):
    tally.add("error", "text files without a caption", "write one, or remove the ids", name)
  for line in lines:
    if not line.tokens:
      tally.add("warning", "captions without tokens", "evaluators need caption#lemma/POS ...#start#end; "
                "motion_jax.text.tagger makes simple ones", name)
    if line.end and not 0 <= line.start < line.end:
      tally.add("warning", "time tags that end before they start", "correct the seconds", name)
    elif line.start > seconds:
      tally.add("warning", "time tags beyond the end of the clip", "correct the seconds", name)
  return [line.caption for line in lines]
