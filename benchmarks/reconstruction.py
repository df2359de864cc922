"""How well the tokenizer gives motion back: joint error in millimetres on held-in and held-out clips of archives.

  python benchmarks/reconstruction.py --archives path/to/cmu path/to/bandai [--model cmdm-small] [--clips 150]

Columns: with heading and path summed up from the features, joints root-aligned (docs/papers/cmdm.md#reconstruction);
per frame, heading and path taken from the real features, so that no error adds up; root = distance of the two paths at
their end. The last table says what the representation itself loses: joints -> features -> joints, and features ->
joints -> features.
"""
import argparse

import numpy as np

from motion_jax import loading
from motion_jax.data.datasets.archive import read_archive
from motion_jax.motion.representations import canonicalize, extract, to_features, to_joints


def errors(loaded, features):
  features = features[:min(len(features), 192) // 4 * 4]
  made = loaded.reconstruct(features)
  posed = np.concatenate([features[:, :4], made[:, 4:]], axis=1)  # real root, made body
  real, whole, body = (to_joints(x.astype(np.float32)) for x in (features, made, posed))
  distance = lambda a, b: np.linalg.norm(a - b, axis=-1).mean() * 1000
  aligned = distance(real - real[:, :1], whole - whole[:, :1])
  end = np.linalg.norm(real[-1, 0] - whole[-1, 0]) * 1000
  return aligned, distance(real, body), end, np.linalg.norm(real[-1, 0] - real[0, 0]) * 1000


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--archives", nargs="+", required=True)
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--clips", type=int, default=150, help="clips per archive and split, evenly spread")
  args = parser.parse_args()
  loaded = loading.load(args.model)
  print(f"{loaded.id}; millimetres\n\n{'archive':10} {'split':6} {'clips':>5} {'with heading':>13} {'per frame':>10} "
        f"{'root at end':>12} {'path':>7}")
  trips = []
  for folder in args.archives:
    for split in ("train", "val", "test"):
      clips = [clip for clip in read_archive(folder, split) if clip.num_frames > 24]
      clips = [clips[i] for i in np.unique(np.linspace(0, len(clips) - 1, min(args.clips, len(clips))).astype(int))]
      rows = []
      for clip in clips:
        canonical = canonicalize(clip.joints, mode="corrected")
        features = extract(canonical, mode="corrected").astype(np.float32)
        rows.append(errors(loaded, features))
        if split == "test":
          joints = to_joints(features)
          back = to_features(joints, mode="corrected")
          rest = slice(0, max(len(back) - 81, 1))  # the smoothed heading of the last seconds sees one frame less
          benchmark = to_features(clip.joints, mode="benchmark")
          trips.append((np.abs(joints - canonical[:-1]).max() * 1000, np.abs(back - features[:-1])[rest, :259].max(),
                        np.abs(to_joints(benchmark) - canonicalize(clip.joints)[:-1]).max() * 1000))
      rows = np.mean(rows, axis=0)
      print(f"{folder.rstrip('/').split('/')[-1]:10} {split:6} {len(clips):5d} {rows[0]:13.1f} {rows[1]:10.1f} "
            f"{rows[2]:12.0f} {rows[3]:7.0f}", flush=True)
  joints, features, benchmark = np.array(trips).T
  print(f"\nround trips on {len(trips)} test clips, largest differences: joints -> features -> joints "
        f"{joints.max():.4f} mm (corrected), {benchmark.max():.1f} mm worst and {np.median(benchmark):.4f} mm median "
        f"(benchmark); features -> joints -> features {features.max():.1e}")


if __name__ == "__main__":
  main()
