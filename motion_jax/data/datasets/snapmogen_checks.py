"""The checks of `motion-jax data doctor` for SnapMoGen folders."""
import collections
import hashlib
import pathlib

import numpy as np
import tqdm

from motion_jax.data import checks
from motion_jax.data.datasets.snapmogen_files import FPS, MIN_FRAMES, SPLITS, folder_stats, read_captions, read_ids
from motion_jax.motion.representations import get_layout, to_joints
from motion_jax.motion.stats import RunningStats


def examine(folder, tally, progress):
  """Checks a folder's recordings, spans, captions, statistics and the bodies of its features.

  Faults are added to `tally`; returns the facts to print, [(name, text), ...].
  """
  folder, layout = pathlib.Path(folder), get_layout("snapmogen")
  files = {path.stem: path for path in sorted((folder / "renamed_feats").glob("*.npy"))}
  spans, names, captions = _read_lists(folder, tally)
  tally.add_all("error", "recordings in two splits", checks.LEAK,
                sorted(n for n, splits in names.items() if len(splits) > 1))
  tally.add_all("error", "ids without a recording", "restore renamed_feats/NAME.npy, or remove the ids",
                sorted(set(names) - set(files)))
  ids = [span for listed in spans.values() for span in listed]
  tally.add_all("error", "ids twice", "remove the second line",
                sorted(name for name, count in collections.Counter(span.id for span in ids).items() if count > 1))
  if captions:
    tally.add_all("error", "ids without a caption", "loaders fail or leave them out: write captions, or remove the ids",
                  sorted(span.id for span in ids if not any(captions.get(span.id, ((), ())))))
  rows, sums = {}, RunningStats(layout)
  body, hashes = checks.Body(tally, layout.skeleton), collections.defaultdict(list)
  for name, path in tqdm.tqdm(files.items(), desc="recordings", unit="recording", disable=not progress):
    features = checks.load(path, tally)
    if features is None:
      continue
    if features.ndim != 2 or features.shape[1] != layout.dim or len(features) < 2:
      tally.add("error", f"features that are not (2 rows or more, {layout.dim})", "make them again from the BVH file "
                "(motion_jax.data.datasets.snapmogen.bvh_features)", f"{name} {features.shape}")
    elif not np.isfinite(features).all():
      tally.add("error", "features with NaN or infinity", "make them again, or remove their ids", name)
    else:
      rows[name] = len(features)
      sums.add(features)
      hashes[hashlib.sha1(features.tobytes()).hexdigest()].append(name)
      body.check(name, to_joints(features.astype(np.float32), layout))
  body.report()
  tally.add_all("error", "ids that end behind their recording", "correct the last number of the id",
                sorted(span.id for span in ids if span.end > rows.get(span.recording, span.end)))
  short = sum(span.end - span.start < MIN_FRAMES for span in ids)
  if short:
    tally.add("note", f"ids of less than {MIN_FRAMES} rows", "text-to-motion loaders leave them out",
              count=short)
  checks.report_duplicates(hashes, {split: [s.recording for s in listed] for split, listed in spans.items()}, tally)
  if rows:
    _examine_stats(folder, sums.stats(), tally)
  by_split = {split: [text for span in listed for kind in captions.get(span.id, ()) for text in kind]
              for split, listed in spans.items()}
  written = [sum(len(entry[kind]) for entry in captions.values()) for kind in (0, 1)]
  return [("format", f"SnapMoGen layout, {layout.dim} features"),
          ("recordings", f"{len(files)}, {sum(rows.values()) / FPS / 3600:.2f} hours at 30 frames a second"),
          ("spans", ", ".join(f"{split} {len(listed)}" for split, listed in spans.items())),
          ("captions", f"{written[0]} by people, {written[1]} by a machine"),
          *checks.shared_captions(by_split), *body.facts()]


def _read_lists(folder, tally):
  """({split: its spans}, {recording: its splits}, captions) of a folder, as far as they can be read."""
  spans, names, captions = {}, collections.defaultdict(set), {}
  for split in SPLITS:
    try:
      spans[split] = read_ids(folder, split)
      for span in spans[split]:
        names[span.recording].add(split)
    except FileNotFoundError:
      tally.add("error" if split == "train" else "warning", f"no data_split_info/{split}_ids.txt",
                "restore it: ids NAME#start#end, one a line")
    except ValueError as error:
      tally.add("error", "split files that cannot be read", "each line is NAME#start#end",
                f"{split} ({checks.error_detail(error, folder)})"[:120])
  try:
    captions = read_captions(folder)
  except (FileNotFoundError, ValueError) as error:
    tally.add("error", "no captions", 'all_caption_clean.json is {id: {"manual": [...], "gpt": [...]}}',
              checks.error_detail(error, folder)[:120])
  return spans, names, captions


def _examine_stats(folder, computed, tally):
  """Reports statistics of other features. The dataset's own are of all recordings: small differences are normal."""
  try:
    stats = folder_stats(folder)
  except (FileNotFoundError, ValueError) as error:
    tally.add("error", "no statistics, or not these features'", "restore meta_data/mean.npy and std.npy",
              checks.error_detail(error, folder)[:120])
    return
  off = np.abs(stats.mean - computed.mean) / np.maximum(computed.std, stats.std)
  if off.max() > 1:
    tally.add("error", "meta_data/mean.npy is not this data's", "features and statistics come from different versions "
              "of the data: restore the dataset's own", f"column {int(off.argmax())}")
