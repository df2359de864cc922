"""Control by constraints: distance, quality and speed of each way to apply them, one after the other.

  python benchmarks/control.py --model cmdm-small --data path/to/cmu path/to/bandai [--clips 8] [--out control.json]

Prints a table for each kind of constraint: paths of test clips, poses at a quarter of their frames, a hand at five of
them, and curves that no training clip follows (`motion_jax.control.paths`). Its rows are the same motions, seeds and
prompts without constraints, with a network that takes them as input (where it was trained to), with guidance through
the decoder besides, and projected onto the constraints in the end. Milliseconds are those of a second call, a batch of
all motions, divided by their number; the last line has those of the sampler alone, with their ratio to no constraints.
"""
import argparse
import json
import os
import pathlib
import time

import jax
import numpy as np

import motion_jax
from motion_jax.control import paths, signal
from motion_jax.data.datasets.archive import read_archive
from motion_jax.metrics.physics import planted_speed, skating_ratio
from motion_jax.models.keys import keys_of
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax_studio import Pipeline

COLUMNS = "mean error, m", "worst, m", "skating", "planted, m/s", "fastest joint, m/s", "ms a motion"
WALKS = ("a person walks", "a person walks forward")
WAYS = {"prompt alone": None, "conditioned": dict(control_steps=0, exact=False), "and guided": dict(exact=False),
        "and projected": dict(exact=True)}


def constrained(joints, given):
  """The `ControlSignal` (1, T) of those places of joints (T, 22, 3) that are given (T, 22, 3)."""
  return signal.ControlSignal(np.where(given, joints, 0)[None].astype(np.float32), given[None],
                              np.zeros((1, len(joints)), np.float32), np.zeros((1, len(joints)), bool))


def test_clips(folders, count, frames):
  """[(words, joints (frames, 22, 3))] of test rows, evenly through each archive, from the origin on and faced +Z."""
  found = []
  for folder in folders:
    clips = [clip for clip in read_archive(folder, "test") if clip.num_frames >= frames]
    for clip in clips[::max(len(clips) // count, 1)][:count]:
      joints = retarget(clip.joints)[:frames]
      (right_hip, left_hip), (right_shoulder, left_shoulder) = HUMANML3D.hips, HUMANML3D.shoulders
      across = joints[0, right_hip] - joints[0, left_hip] + joints[0, right_shoulder] - joints[0, left_shoulder]
      angle = np.arctan2(across[2], -across[0])
      joints = joints - joints[0, 0] * [1, 0, 1]
      x, z = joints[..., 0].copy(), joints[..., 2].copy()
      joints[..., 0], joints[..., 2] = x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)
      found.append((clip.captions[0].text, joints))
  return found


def kinds(clips, model):
  """{name: [(words, ControlSignal (1, T))]}; curves end where the model's longest motion does."""
  fps, most = model.fps, int(min(model.max_seconds, 60) * model.fps)
  rng, found = np.random.default_rng(0), {"path of a test clip": [], "poses at 25 %": [], "hand at 5 frames": []}
  for words, joints in clips:
    count = len(joints)
    given = {name: np.zeros(joints.shape, bool) for name in found}
    given["path of a test clip"][:, 0, ::2] = True
    given["poses at 25 %"][rng.choice(count, count // 4, replace=False)] = True
    given["hand at 5 frames"][rng.choice(count, 5, replace=False), 20] = True
    for name, where in given.items():
      found[name].append((words, constrained(joints, where)))
  for name, curve in paths.CURVES.items():
    path = curve(fps)[:most]
    joints, given = np.zeros((len(path), 22, 3)), np.zeros((len(path), 22, 3), bool)
    joints[:, 0, ::2], given[:, 0, ::2] = path, True
    found[name] = [(words, constrained(joints, given)) for words in WALKS * 2]
  return found


def measured(model, rows, options):
  """Numbers of motions of rows (words, signal) made in one way."""
  words, frames = [row[0] for row in rows], [row[1].frames for row in rows]
  control = signal.stack([row[1] for row in rows])
  pipeline = Pipeline(model)
  given = dict(seeds=range(len(rows)), cleanup=False, plan=False)
  make = lambda: pipeline(words, frames, **given, **({} if options is None else dict(control=control) | options))
  make()
  began = time.perf_counter()
  motions = make()
  seconds = time.perf_counter() - began
  off = [np.linalg.norm(np.where(one.given[0], motion.joints - one.positions[0], 0), axis=-1)[one.given[0].any(-1)]
         for motion, (_, one) in zip(motions, rows)]
  speed = max(np.linalg.norm(np.diff(motion.joints, axis=0), axis=-1).max() for motion in motions) * model.fps
  return {"mean": float(np.mean([one.mean() for one in off])), "worst": float(max(one.max() for one in off)),
          "skating": float(np.mean([skating_ratio(motion.joints) for motion in motions])),
          "planted": float(np.mean([planted_speed(motion.joints) for motion in motions])),
          "top_speed": float(speed), "ms": 1000 * seconds / len(rows)}


def sampler_times(model, rows, repeats=5):
  """{way: milliseconds a motion} of the sampler alone, the least of several calls that take turns."""
  words, frames = [row[0] for row in rows], [row[1].frames for row in rows]
  control, (keys, seeds) = signal.stack([row[1] for row in rows]), keys_of(None, range(len(rows)), len(rows))
  ways = {"prompt alone": lambda: model.sample(words, frames, keys, seeds, False, {}),
          "conditioned": lambda: model.sample(words, frames, keys, seeds, False, dict(control_steps=0), control),
          "and guided": lambda: model.sample(words, frames, keys, seeds, False, {}, control)}
  found = {way: [] for way in ways}
  for _ in range(repeats + 1):
    for way, make in ways.items():
      began = time.perf_counter()
      make()
      found[way].append(1000 * (time.perf_counter() - began) / len(rows))
  return {way: min(times[1:]) for way, times in found.items()}


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--data", nargs="+", required=True, help="archives whose test rows give the constraints")
  parser.add_argument("--clips", type=int, default=8, help="test clips of each archive")
  parser.add_argument("--frames", type=int, default=72)
  parser.add_argument("--out", type=pathlib.Path, help="a JSON file for all numbers")
  args = parser.parse_args()
  model = motion_jax.load(args.model)
  clips = test_clips(args.data, args.clips, args.frames)
  real = {"skating": np.mean([skating_ratio(joints) for _, joints in clips]),
          "planted": np.mean([planted_speed(joints) for _, joints in clips]),
          "top_speed": max(np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() for _, joints in clips) * model.fps}
  print(f"{args.model}, {os.cpu_count()} cores, {jax.devices()[0].device_kind}; {len(clips)} test clips of "
        f"{args.frames} frames: skating {real['skating']:.3f}, planted feet {real['planted']:.3f} m/s, fastest joint "
        f"{real['top_speed']:.1f} m/s\n")
  found = {"model": args.model, "jax": jax.__version__, "real": {name: float(value) for name, value in real.items()}}
  for kind, rows in kinds(clips, model).items():
    print(f"| {kind} | " + " | ".join(COLUMNS) + " |\n|" + " --- |" * (len(COLUMNS) + 1))
    found[kind] = {}
    for way, options in WAYS.items():
      one = found[kind][way] = measured(model, rows, options)
      print(f"| {way} | {one['mean']:.4f} | {one['worst']:.3f} | {one['skating']:.3f} | {one['planted']:.3f} | "
            f"{one['top_speed']:.1f} | {one['ms']:.0f} |", flush=True)
    print()
  found["sampler"] = sampler = sampler_times(model, kinds(clips, model)["path of a test clip"])
  plain = sampler["prompt alone"]
  print("the sampler alone, a path of each motion: " + ", ".join(
      f"{way} {ms:.0f} ms a motion ({ms / plain:.2f})" for way, ms in sampler.items()))
  if args.out:
    args.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
  main()
