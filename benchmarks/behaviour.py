"""Does the motion do what the sentence says? Prompts with a measure each, over several seeds.

  python benchmarks/behaviour.py [--model cmdm-small] [--seeds 8] [--pictures FOLDER]

Prints a table: per prompt how many of the seeds pass, and the measure's values. Directions are those of the body in
frame 0: +z ahead, +x to its left; angles are degrees, positive to the left.
"""
import argparse
import pathlib

import numpy as np

from motion_jax import export, loading
from motion_jax.motion.skeleton import HUMANML3D, facing

JOINT = {name: index for index, name in enumerate(HUMANML3D.joints)}


def path_length(joints):
  return float(np.linalg.norm(np.diff(joints[:, 0, [0, 2]], axis=0), axis=-1).sum())


def ahead(joints):
  """Metres gained along the first facing direction."""
  moved = joints[-1, 0] - joints[0, 0]
  return float(moved @ facing(joints[:1].astype(np.float64))[0])


def heading_change(joints):
  """Degrees turned between the first and the last half second, all turns counted."""
  ahead = facing(joints.astype(np.float64), smooth=5)
  angle = np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2]))
  return float(np.degrees(angle[-10:].mean() - angle[:10].mean()))


def speed(joints):
  """Metres a second over the fastest second."""
  steps = np.linalg.norm(np.diff(joints[:, 0, [0, 2]], axis=0), axis=-1) * 20
  return float(np.convolve(steps, np.ones(20) / 20, mode="valid").max())


def above_shoulder(joints, side):
  """Highest wrist height over its shoulder, metres."""
  return float((joints[:, JOINT[f"{side}_wrist"], 1] - joints[:, JOINT[f"{side}_shoulder"], 1]).max())


def wrist_swings(joints, side):
  """Turning points of the raised wrist's sideways path with an amplitude over 4 cm: what makes it a wave."""
  wrist, elbow = joints[:, JOINT[f"{side}_wrist"]], joints[:, JOINT[f"{side}_elbow"]]
  raised = wrist[:, 1] > joints[:, JOINT[f"{side}_shoulder"], 1] - 0.1
  x = (wrist - elbow)[raised] @ facing(joints[:1].astype(np.float64))[0][[2, 1, 0]] if raised.any() else np.zeros(1)
  turns, extreme, rising = 0, x[0], True
  for value in x:
    if (value > extreme) == rising:
      extreme = value
    elif abs(value - extreme) > 0.04:
      turns, extreme, rising = turns + 1, value, not rising
  return turns


def hop(joints):
  """How far both feet leave the ground at once, metres over the lower foot's usual height."""
  feet = joints[:, [JOINT["left_foot"], JOINT["right_foot"]], 1].min(1)
  return float(feet.max() - np.median(feet))


def kick(joints):
  """Highest foot over the other, metres."""
  left, right = joints[:, JOINT["left_foot"], 1], joints[:, JOINT["right_foot"], 1]
  return float(np.abs(left - right).max())


def reach(joints):
  """Fastest wrist relative to the pelvis, metres a second."""
  wrists = joints[:, [JOINT["left_wrist"], JOINT["right_wrist"]]] - joints[:, :1]
  return float(np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max() * 20)


def bend(joints):
  """Deepest forward bend of the trunk, degrees from upright."""
  trunk = joints[:, JOINT["neck"]] - joints[:, 0]
  return float(np.degrees(np.arccos(trunk[:, 1] / np.linalg.norm(trunk, axis=-1))).max())


def sink(joints):
  """How far the pelvis goes down, metres."""
  return float(joints[:, 0, 1].max() - joints[:, 0, 1].min())


def activity(joints):
  """Mean speed of all joints about the pelvis, metres a second."""
  return float(np.linalg.norm(np.diff(joints - joints[:, :1], axis=0), axis=-1).mean() * 20)


# prompt -> (what is measured, measure, least, most)
CHECKS = [
    ("a person walks forward", "m ahead", ahead, 1.0, np.inf),
    ("a person runs forward", "m/s at best", speed, 2.0, np.inf),
    ("a person walks backward", "m ahead", ahead, -np.inf, -0.5),
    ("a person walks and turns left", "degrees to the left", heading_change, 40, np.inf),
    ("a person walks and turns right", "degrees to the left", heading_change, -np.inf, -40),
    ("a person waves the right hand", "m over shoulder", lambda j: above_shoulder(j, "right"), 0.0, np.inf),
    ("a person waves the left hand", "m over shoulder", lambda j: above_shoulder(j, "left"), 0.0, np.inf),
    ("a person waves with both arms", "m over shoulder, lower hand",
     lambda j: min(above_shoulder(j, "left"), above_shoulder(j, "right")), 0.0, np.inf),
    ("a person raises the right hand", "m over shoulder", lambda j: above_shoulder(j, "right"), 0.1, np.inf),
    ("a person raises the left hand", "m over shoulder", lambda j: above_shoulder(j, "left"), 0.1, np.inf),
    ("a person jumps forward", "m both feet up", hop, 0.1, np.inf),
    ("a person kicks", "m between feet", kick, 0.3, np.inf),
    ("a person punches", "m/s of a wrist", reach, 3.0, np.inf),
    ("a person bows", "degrees of bend", bend, 30, np.inf),
    ("a person sits down", "m of pelvis", sink, 0.2, np.inf),
    ("a person dances", "m/s of joints", activity, 0.3, np.inf),
]


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--seeds", type=int, default=8)
  parser.add_argument("--guidance", type=float)
  parser.add_argument("--pictures", help="folder for a strip of each prompt's first seed")
  args = parser.parse_args()
  loaded = loading.load(args.model)
  print(f"{loaded.id}, {args.seeds} seeds\n")
  print(f"{'prompt':34} {'pass':>6}  {'median':>7}  measure: values")
  passed = total = 0
  for prompt, unit, measure, least, most in CHECKS:
    made = loaded.generate([prompt] * args.seeds, loaded.natural_frames(prompt), seeds=range(args.seeds),
                           guidance_scale=args.guidance)
    values = [measure(motion.joints) for motion in made]
    good = sum(least <= value <= most for value in values)
    passed, total = passed + good, total + len(values)
    print(f"{prompt:34} {good:3d}/{len(values)}  {np.median(values):7.2f}  {unit}: "
          + " ".join(f"{value:.2f}" for value in values), flush=True)
    if args.pictures:
      folder = pathlib.Path(args.pictures)
      folder.mkdir(parents=True, exist_ok=True)
      export.strip(made[0], folder / f"{prompt.replace(' ', '_')}.png")
  print(f"\n{passed} of {total}")


if __name__ == "__main__":
  main()
