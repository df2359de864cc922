"""What a tokenizer's alignment with a teacher buys: models side by side on the test clips of archives.

  python benchmarks/alignment.py --models runs/aligned runs/plain --archives path/to/cmu path/to/bandai \
      [--teacher part-tmr-small] [--seeds 2]

Reconstruction in millimetres (root-aligned, heading summed up); retrieval of generated motion by the teacher's own
recall, one motion for each caption of the test clips and seed, among all of them; jerk around the borders of long
motions with six prompts each (PJ, AUJ: docs/papers/cmdm.md#long-horizon; 30 frames on either side, against the mean of
real clips), as the network made them. The row "real" is the test clips themselves.
"""
import argparse

import jax
import numpy as np

from motion_jax import loading, retrieval
from motion_jax.data.datasets.archive import read_archive
from motion_jax.metrics import physics, scores
from motion_jax.motion.representations import to_joints
from motion_jax.training.setup import reconstruction_error

FRAMES = 96  # of every generated motion: one compiled function
SEQUENCE = (6, 4.0)  # prompts, seconds each
BATCH = 32


def test_clips(folders):
  return [clip for folder in folders for clip in read_archive(folder, "test") if clip.num_frames >= 24]


def recall(retriever, captions, features):
  """Shares of captions whose motion is among the nearest, and the mean cosine of matched pairs."""
  similarity = retriever.embed_text(captions) @ retriever.embed_motion(features).T
  found = scores.retrieval(similarity)
  return [100 * found[name] for name in ("r1", "r2", "r3", "back_r1")] + [np.diag(similarity).mean()]


def generated(loaded, captions, seed):
  features = []
  for i in range(0, len(captions), BATCH):
    batch = captions[i:i + BATCH]
    batch += batch[-1:] * (BATCH - len(batch))  # one batch size: one compilation
    made = loaded.generate(batch, FRAMES, seeds=[1000 * seed + i + j for j in range(BATCH)])
    features += list(made.features[:len(captions) - i])
  return features


def borders(loaded, captions, count):
  rng = np.random.default_rng(0)
  prompts, seconds = SEQUENCE
  draw = lambda: rng.choice(len(captions), prompts, replace=False)
  sequences = [[(captions[j], seconds) for j in draw()] for _ in range(count)]
  made = loaded.multi_prompts(sequences, seeds=list(range(count)))
  cuts = lambda motion: [round(caption.start * loaded.fps) for caption in motion.captions[1:]]
  return np.concatenate([physics.cut_transitions(to_joints(motion.features), cuts(motion)) for motion in made])


def reconstruction(loaded, features):
  """Millimetres between features (a list of (T, F)) and what the tokenizer gives back."""
  features = [loaded.stats.normalize(x) for x in features]
  return reconstruction_error(jax.jit(loaded.codec.reconstruct), features, loaded.stats)


def print_row(name, mm, row, curve, level):
  numbers = " | ".join(f"{value:.1f}" for value in row[:4])
  print(f"| {name} | {mm} | {numbers} | {row[4]:.3f} | {physics.peak_jerk(curve):.4f} | "
        f"{physics.area_under_jerk(curve, level):.3f} |", flush=True)


def real_windows(clips, width=60):
  rng = np.random.default_rng(0)
  long = [clip.joints for clip in clips if clip.num_frames >= width]
  starts = [rng.integers(len(x) - width + 1) for x in long]
  return np.stack([x[start:start + width] for x, start in zip(long, starts)])


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--models", nargs="+", required=True)
  parser.add_argument("--archives", nargs="+", required=True)
  parser.add_argument("--teacher", default="part-tmr-small")
  parser.add_argument("--seeds", type=int, default=2)
  parser.add_argument("--sequences", type=int, default=16)
  args = parser.parse_args()
  retriever = retrieval.load(args.teacher)
  clips = test_clips(args.archives)
  first = {clip.captions[0].text: clip for clip in reversed(clips)}
  captions = sorted(first)
  curve = physics.jerk_curve(real_windows(clips))
  level = curve.mean()
  print(f"{len(clips)} test clips, {len(captions)} captions, {args.seeds} seeds; {args.sequences} motions of "
        f"{SEQUENCE[0]} prompts, {SEQUENCE[1]:g} s each; real jerk {level:.4f}\n")
  heads = ["model", "reconstruction, mm", "R@1", "R@2", "R@3", "motion to text R@1", "cosine", "PJ", "AUJ"]
  print(f"| {' | '.join(heads)} |\n" + "| --- " * len(heads) + "|")
  features = [retriever.features_of(clip) for clip in clips]
  row = recall(retriever, captions, [retriever.features_of(first[caption]) for caption in captions])
  print_row("real", "-", row, curve, level)
  for name in args.models:
    loaded = loading.load(name)
    rows = [recall(retriever, captions, generated(loaded, captions, seed)) for seed in range(args.seeds)]
    made = physics.jerk_curve(borders(loaded, captions, args.sequences))
    print_row(name, f"{reconstruction(loaded, features):.1f}", np.mean(rows, axis=0), made, level)


if __name__ == "__main__":
  main()
