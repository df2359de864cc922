"""What cleanup does to motions of a model, and to real ones, which it should leave as they are.

  python benchmarks/cleanup.py path/to/cmu path/to/bandai [--model cmdm-small ...] [--clips 40]

Prints a row of Markdown for each: the 99th percentile of the knees' acceleration, how many legs are straighter than
175 degrees, jerk, how fast the slowest of four points of the feet goes while the lower toes are under 4 cm ("planted"),
how deep feet are in the floor, and how far the body gets.
"""
import argparse
import pathlib

import numpy as np

from motion_jax import loading
from motion_jax.data.datasets.registry import find_dataset
from motion_jax.metrics.physics import planted_speed
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.representations import extract
from motion_jax.motion.skeleton import HUMANML3D

PROMPTS = ("a person walks forward", "a person walks backward", "a person runs forward", "a person walks slowly",
           "a person walks quickly", "a person turns left while walking", "a person jumps",
           "a person kicks with the right foot", "a person throws a punch with the right hand",
           "a person waves the right hand", "a person bows", "a person dances", "a person sidesteps to the left",
           "a person squats down and stands up", "a person stands still", "a person jogs",
           "a person raises the left hand", "a person throws a ball", "a person hops", "a person walks in a circle")
LEGS = [HUMANML3D.chains[0][1:4], HUMANML3D.chains[1][1:4]]  # hip, knee, ankle
FEET = list(HUMANML3D.left_feet + HUMANML3D.right_feet)
FPS = 20


def knee_acceleration(joints):
  """(T - 2, 2), metres a second squared."""
  return np.linalg.norm(np.diff(joints[:, [leg[1] for leg in LEGS]], 2, axis=0), axis=-1) * FPS ** 2


def knee_angles(joints):
  """(T, 2) degrees; 180 is a straight leg."""
  angles = []
  for hip, knee, ankle in LEGS:
    thigh, shin = joints[:, hip] - joints[:, knee], joints[:, ankle] - joints[:, knee]
    lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shin, axis=-1)
    angles.append(np.degrees(np.arccos(np.clip((thigh * shin).sum(-1) / lengths, -1, 1))))
  return np.stack(angles, axis=1)


def row(name, clips):
  """A row of the table, of a list of joints (T, 22, 3)."""
  every = lambda measure: np.concatenate([measure(clip).ravel() for clip in clips])
  mean = lambda measure: np.mean([measure(clip) for clip in clips])
  numbers = (
      f"{np.percentile(every(knee_acceleration), 99):.1f}", f"{100 * (every(knee_angles) > 175).mean():.2f}",
      f"{mean(lambda x: np.linalg.norm(np.diff(x, 3, axis=0), axis=-1).mean()) * FPS ** 3:.0f}",
      f"{mean(planted_speed):.3f}", f"{1000 * mean(lambda x: -x[:, FEET, 1].min(1).clip(None, 0).mean()):.1f}",
      f"{mean(lambda x: np.linalg.norm((x[-1, 0] - x[0, 0])[[0, 2]])):.2f}")
  return f"| {name} | " + " | ".join(numbers) + " |"


def real_clips(folder, count):
  """[(joints (T, 22, 3), contacts (T, 4))] of an archive, evenly through it, ten seconds at the most."""
  clips = [clip for clip in find_dataset(folder).clips(folder) if clip.num_frames > 60]
  chosen = [clips[i] for i in np.linspace(0, len(clips) - 1, min(count, len(clips))).astype(int)]
  joints = [clip.joints[:200].astype(np.float64) for clip in chosen]
  return [(x[:-1], extract(x)[:, -4:]) for x in joints]


def made_clips(name):
  """[(joints, contacts or None)] of a model, six seconds of each prompt, as they come from its network."""
  model = loading.load(name)
  made = model.generate(PROMPTS, seconds=6.0, seeds=range(len(PROMPTS)))
  return [(motion.joints.astype(np.float64), model.stats.layout.contacts(motion.features)) for motion in made]


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("data", nargs="*", help="archives of real motion")
  parser.add_argument("--model", nargs="*", default=["cmdm-small", "cdamd-small"])
  parser.add_argument("--clips", type=int, default=40, help="of each archive (40)")
  args = parser.parse_args()
  print("| | knees, m/s² | straight, % | jerk, m/s³ | planted, m/s | in the floor, mm | travelled, m |\n"
        "| --- | --- | --- | --- | --- | --- | --- |")
  for name in [*args.data, *args.model]:
    clips = real_clips(name, args.clips) if name in args.data else made_clips(name)
    print(row(pathlib.Path(name).name, [joints for joints, _ in clips]), flush=True)
    cleaned = [clean_up(joints, contacts).astype(np.float64) for joints, contacts in clips]
    print(row("cleaned", cleaned), flush=True)


if __name__ == "__main__":
  main()
