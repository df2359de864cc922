"""An hour of motion from one stream: does memory stay flat, time per block, the floor, and does the body keep moving?

  python benchmarks/endless.py --out FOLDER [--minutes 60] [--model cmdm-small] [--lag 2]

Prompts follow each other in a cycle, each for its natural length. Writes FOLDER/endless.md, a table with a row per
minute, and strips of the first, middle and last minute; prints the table's start, middle and end. Columns: ms per block
(12 frames) and resident memory; height of the lowest joint, 5th percentile; mean speed of the root over the ground and
of the wrists relative to it; the share of frames in which no joint moves by more than 1 mm; how far from the start.
"""
import argparse
import gc
import pathlib
import time

import jax
import numpy as np

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.utils.atomic import atomic_path
from motion_studio import Pipeline

PROMPTS = ("a person walks forward", "a person waves with the right hand", "a person walks in a circle",
           "a person jumps up and down", "a person runs forward", "a person sits down", "a person stands up",
           "a person walks forward and turns around", "a person kicks with the right foot", "a person stands still")
AHEAD = 20.0  # seconds before they count that words are said: before their blocks begin
COLUMNS = ("minute", "ms / block", "MB", "floor mm", "root m/s", "wrists m/s", "still %", "metres away")


def resident_megabytes():
  """Memory of this process now; its peak where the system does not tell."""
  status = pathlib.Path("/proc/self/status")
  if status.is_file():
    return int(status.read_text().split("VmRSS:")[1].split()[0]) / 1e3
  import resource
  return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def measures(joints, fps):
  """Floor, speeds, stillness and distance of one minute of joints (T, J, 3)."""
  steps = np.linalg.norm(np.diff(joints, axis=0), axis=-1)
  root = np.linalg.norm(np.diff(joints[:, 0, [0, 2]], axis=0), axis=-1).mean() * fps
  wrists = joints[:, [20, 21]] - joints[:, :1]
  wrists = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).mean() * fps
  return (1000 * np.percentile(joints[..., 1].min(1), 5), root, wrists, 100 * (steps.max(1) < 1e-3).mean(),
          np.linalg.norm(joints[-1, 0, [0, 2]]))


def run(args):
  pipeline = Pipeline(args.model)
  made = pipeline.model
  stream = pipeline.stream(PROMPTS[0], seed=args.seed, lag=args.lag)
  fps, out = made.fps, pathlib.Path(args.out)
  lengths = [pipeline.planner.natural_frames(prompt) / fps for prompt in PROMPTS]
  out.mkdir(parents=True, exist_ok=True)
  kept = {1, (args.minutes + 1) // 2, args.minutes}
  at, told, rest = 0.0, 0, np.zeros((0, made.stats.layout.skeleton.num_joints, 3), np.float32)
  next_words, rows, spoken = lengths[0], [], [(0.0, PROMPTS[0])]
  minute_frames = int(60 * fps)
  for minute in range(1, args.minutes + 1):
    blocks, times = [rest], []
    while sum(map(len, blocks)) < minute_frames:
      while next_words <= at + AHEAD:
        told += 1
        stream.say(PROMPTS[told % len(PROMPTS)], after=next_words - at)
        spoken.append((next_words, PROMPTS[told % len(PROMPTS)]))
        next_words += lengths[told % len(PROMPTS)]
      start = time.perf_counter()
      blocks.append(next(stream))
      times.append(time.perf_counter() - start)
      at += len(blocks[-1]) / fps
    joints = np.concatenate(blocks)
    joints, rest = joints[:minute_frames], joints[minute_frames:]
    gc.collect()
    rows.append((minute, 1000 * np.median(times), resident_megabytes(), *measures(joints, fps)))
    if minute in kept:
      begin = 60.0 * (minute - 1)
      ends = [start for start, _ in spoken[1:]] + [begin + 60]
      captions = tuple(Caption(prompt, max(start - begin, 0.0), min(end - begin, 60.0))
                       for (start, prompt), end in zip(spoken, ends) if end > begin and start < begin + 60)
      clip = Clip(joints - joints[0, 0] * [1, 0, 1], fps, captions, id=f"minute_{minute}")
      export.save(clip, out / f"minute_{minute:02d}.npz")
      export.save(clip, out / f"minute_{minute:02d}.png")
    spoken = spoken[-40:]
    if minute in kept or minute % 10 == 0:
      print(row_text(rows[-1]), flush=True)
    write_table(rows, out / "endless.md", args, made)
  return rows


def row_text(row):
  return "| {} | {:.1f} | {:.0f} | {:.1f} | {:.2f} | {:.2f} | {:.1f} | {:.1f} |".format(*row)


def write_table(rows, path, args, made):
  head = (f"{args.minutes} minutes from one stream of {made.id}, lag {args.lag or made.config.sampler.lag}, seed "
          f"{args.seed}, on {jax.default_backend()}.\n\n| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}\n")
  with atomic_path(path) as temporary:
    temporary.write_text(head + "\n".join(map(row_text, rows)) + "\n")


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--out", required=True, help="folder for the table and the strips")
  parser.add_argument("--minutes", type=int, default=60)
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--lag", type=int)
  parser.add_argument("--seed", type=int, default=0)
  run(parser.parse_args())


if __name__ == "__main__":
  main()
