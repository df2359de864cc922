"""Judge folders of joints (T, 22, 3) in metres, y up, 20 frames a second: physics of each, FID against the first.

  python examples/judge_a_folder.py real/ mine/ theirs/      .npy files of at least 40 frames
"""
import pathlib
import sys

import numpy as np

from motion_jax.evaluators.evaluator import load_evaluator
from motion_jax.metrics import fid, physics

evaluator = load_evaluator("evaluator-small")
embeddings = {}
for folder in sys.argv[1:]:
  motions = [np.load(path, allow_pickle=False) for path in sorted(pathlib.Path(folder).glob("*.npy"))]
  rows = [physics.summary(motion) for motion in motions]
  print(f"{folder}: {len(motions)} motions, " + ", ".join(
      f"{name} {np.mean([row[name] for row in rows]):.3f}" for name in ("skating_ratio", "floating_mm", "jerk")))
  features = [evaluator.stats.normalize(evaluator.features_of(motion))[:evaluator.max_frames] for motion in motions]
  lengths = [len(rows) for rows in features]
  padded = np.stack([np.pad(rows, ((0, evaluator.max_frames - len(rows)), (0, 0))) for rows in features])
  embeddings[folder] = evaluator.embed_motion(padded, lengths)
first, *others = embeddings
for folder in others:
  print(f"FID of {folder} against {first}: {fid(embeddings[first], embeddings[folder]):.3f}")
