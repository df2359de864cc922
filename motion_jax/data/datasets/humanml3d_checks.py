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


def examine(folder, found, progress):
  """Checks a folder's clips, splits, lengths, statistics, texts and the bodies that its features give.

  Faults are added to `found`; returns the facts to print, [(name, text), ...].
  """
  for name in ("new_joint_vecs", "new_joints", "texts"):
    if not (folder / name).is_dir():
      found.add("error", f"no folder {name}", "copy it from the data set, or make it with motion-jax data build")
  stems = lambda name, suffix: {path.stem for path in (folder / name).glob(f"*{suffix}")}
  vectors, joints, texts = stems("new_joint_vecs", ".npy"), stems("new_joints", ".npy"), stems("texts", ".txt")
  splits = _splits(folder, found)
  _report_missing(folder, splits, vectors, joints, texts, found)
  if not vectors:
    found.add("error", "no motion in new_joint_vecs", "make the folder again")
    return [("format", "HumanML3D layout")]

  layout = _layout(folder, sorted(vectors), found)
  if layout is None:
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  try:
    info = humanml3d_files.dataset_info(folder)
  except ValueError as error:
    found.add("error", f"dataset.json cannot be used ({checks.error_detail(error, folder / 'dataset.json')})",
              "build again, or remove it where the folder is HumanML3D's or KIT-ML's own")
    return [("format", "HumanML3D layout"), ("clips", str(len(vectors)))]
  body = checks.Body(found, layout.skeleton)
  rows, captions, sums, hashes = {}, {}, RunningStats(layout), collections.defaultdict(list)
  for name in tqdm.tqdm(sorted(vectors), desc="clips", unit="clip", disable=not progress):
    features = _usable_features(folder, name, layout, found)
    if features is None:
      continue
    rows[name] = len(features)
    sums.add(features)
    hashes[hashlib.sha1(features.tobytes()).hexdigest()].append(name)
    recovered = to_joints(features, layout)
    if name in joints:
      saved = checks.load(folder / "new_joints" / f"{name}.npy", found)
      if saved is not None:
        checks.compare_joints(saved, recovered, layout, name, found)
    body.check(name, recovered)
    if name in texts:
      captions[name] = _check_texts(folder / "texts" / f"{name}.txt", name, len(features) / info["fps"], found)
  body.report()
  least = humanml3d_files.MIN_FRAMES[layout.skeleton.name]
  checks.report_lengths(rows, splits, least, found)
  checks.report_duplicates(hashes, splits, found)
  if rows:
    checks.check_stats(folder, layout, sums.stats(), found)
  if abs(info["fps"] - layout.skeleton.fps) > 1e-6:
    found.add("warning", f"{info['fps']:g} frames a second, {layout.skeleton.name} has {layout.skeleton.fps:g}",
              "other tools take the usual rate for granted; build again with --resample")
  seconds = sum(rows.values()) / info["fps"]
  return [("format", f"HumanML3D layout, {layout.name} features ({layout.dim}), {info['mode']} mode"),
          ("clips", f"{len(vectors)} ({sum(name.startswith('M') for name in vectors)} mirrored), "
           + ", ".join(f"{split} {len(ids)}" for split, ids in splits.items())),
          ("length", f"{sum(rows.values())} rows, {seconds / 3600:.2f} hours at {info['fps']:g} frames a second, "
           f"{min(rows.values(), default=0)} to {max(rows.values(), default=0)} rows a clip"),
          *checks.shared_captions({split: [text for one in ids for text in captions.get(one, ())]
                                   for split, ids in splits.items()}), *body.facts()]


def _report_missing(folder, splits, vectors, joints, texts, found):
  """Reports ids of splits without files, and files without others of their clip or an id."""
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


def _usable_features(folder, name, layout, found):
  """Features of a clip; None, and a finding, for those that cannot be used."""
  features = checks.load(folder / "new_joint_vecs" / f"{name}.npy", found)
  if features is None:
    return None
  if features.ndim != 2 or features.shape[1] != layout.dim:
    found.add("error", f"features that are not (rows, {layout.dim})", "make them again; another representation got in",
              f"{name} {features.shape}")
  elif not len(features):
    found.add("error", "clips of no rows", "remove their ids", name)
  elif not np.isfinite(features).all() and name in KNOWN_BAD:
    found.add("error", "known bad clip of HumanML3D with NaN", "remove its id from all split files; it came so, the "
              "papers leave it out", name)
  elif not np.isfinite(features).all():
    found.add("error", "features with NaN or infinity", "remove their ids, or repair the source and build again", name)
  else:
    return features
  return None


def _splits(folder, found):
  """Ids of train, val and test; reports ids that occur twice, in two splits, or apart from their mirror image."""
  splits = {}
  for name in ("train", "val", "test"):
    if (folder / f"{name}.txt").is_file():
      splits[name] = humanml3d_files.read_ids(folder, name)
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
    found.add("note", "clips without a mirrored copy", "fine; motion-jax data build adds them, except with --no-mirror",
              count=alone)
  for derived, parts in (("train_val", ("train", "val")), ("all", ("train", "val", "test"))):
    if (folder / f"{derived}.txt").is_file():
      expected = {one for part in parts for one in splits.get(part, ())}
      if set(humanml3d_files.read_ids(folder, derived)) != expected:
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


def _check_texts(path, name, seconds, found):
  """The captions of a clip; their faults are added to `found`."""
  try:
    lines = read_texts(path)
  except ValueError as error:
    found.add("error", "text files that cannot be read", "each line is caption#tokens#start#end",
              f"{name} ({checks.error_detail(error, path)})"[:120])
    return []
  if not any(line.caption for line in lines):
    found.add("error", "text files without a caption", "write one, or remove the ids", name)
  for line in lines:
    if not line.tokens:
      found.add("warning", "captions without tokens", "evaluators need caption#lemma/POS ...#start#end; "
                "motion_jax.text.tagger makes simple ones", name)
    if line.end and not 0 <= line.start < line.end:
      found.add("warning", "time tags that end before they start", "correct the seconds", name)
    elif line.start > seconds:
      found.add("warning", "time tags beyond the end of the clip", "correct the seconds", name)
  return [line.caption for line in lines]
