"""How well a Unitree G1 follows generated motion: ten prompts, and two minutes streamed with a new prompt every 10 s.

  python benchmarks/robot.py [--model cmdm-small] [--seed 0] [--seconds 120] [--out robot.md] [--picture robot.png]

Prints two tables: errors, limits, slide and steps of each prompt; and of the stream, the largest step of a joint in one
tick of 20 ms within half a second of each change of prompt, beside that of the same prompts generated one by one and
joined. Others measured up to 2.87 rad in one tick where prompts change (strands-labs/robots#2353). Processor seconds.
"""
import argparse
import dataclasses
import pathlib
import time

import machine
import numpy as np
import results
from PIL import Image

from motion_jax import export, robots
from motion_jax.data.clip import Caption, Clip
from motion_jax_studio import Pipeline

PROMPTS = ["a person walks forward", "a person runs", "a person waves the right hand",
           "a person kicks with the right leg", "a person sits down", "a person jumps", "a person turns left",
           "a person walks backward", "a person picks something up", "a person dances"]
SHOWN = [0, 2, 3, 4]  # walk, wave, kick, sit: in the picture
NEAR = 25     # ticks before and after a change of prompt
EVERY = 10.0  # seconds of a prompt in the stream


def row_of(name, motion, report):
  limits = ", ".join(f"{joint.removesuffix('_joint')} {100 * share:.0f} %" for joint, share in
                     list(report.limits.items())[:2])
  return [name, f"{motion.seconds:.1f}", *(f"{mean:.0f}, {most:.0f}" for mean, most in (
      report.pelvis, report.feet, report.hands)), f"{100 * report.at_limit:.0f} % ({limits or 'none'})",
      f"{report.largest_step:.2f}", f"{report.slide:.1f}", f"{report.in_floor:.1f}", f"{motion.meta['cost']:.2f}"]


def followed(clip, robot):
  began = time.process_time()
  motion = robots.retarget(clip, robot)
  cost = (time.process_time() - began) / clip.seconds
  return dataclasses.replace(motion, meta=motion.meta | {"cost": cost})


def streamed(pipeline, robot, seed, seconds):
  """(motion, clip, ticks at which prompts change) of a stream whose prompt changes every 10 s."""
  fps, stream = pipeline.model.fps, None
  live = pipeline.stream(PROMPTS[0], seed=seed, plan=False, num_frames=round(seconds * fps))
  stream, rows, joints, captions, cost = robots.Stream(robot, fps), [], [], [Caption(PROMPTS[0])], 0.0
  for block in live:
    began = time.process_time()
    rows.append(stream.push(block))
    cost += time.process_time() - began
    joints.append(block)
    if sum(map(len, joints)) / fps >= EVERY * len(captions) and len(captions) * EVERY < seconds:
      prompt = PROMPTS[len(captions) % len(PROMPTS)]
      captions.append(Caption(prompt, live.say(prompt) / fps))
  began = time.process_time()
  rows.append(stream.finish())
  cost += time.process_time() - began
  clip = Clip(np.concatenate(joints), fps, tuple(captions))
  motion = robots.RobotMotion(robot, np.concatenate(rows), robots.RATE, meta={"cost": cost / clip.seconds},
                              captions=clip.captions)
  return motion, clip, [round(caption.start * robots.RATE) for caption in captions[1:]]


def largest(angles, ticks=None):
  """The largest step of a joint in one tick: near each of ticks, or of all."""
  steps = np.abs(np.diff(angles, axis=0)).max(1)
  return float(steps.max()) if ticks is None else [float(steps[max(t - NEAR, 0):t + NEAR].max()) for t in ticks]


def draw(motions, path):
  """Rows of moments, as a .png of 96 colours."""
  export.strip(motions, path, num=7, height=180)
  with Image.open(path) as picture:
    picture.convert("RGB").quantize(96).save(path, optimize=True)


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--seed", type=int, default=0)
  parser.add_argument("--seconds", type=float, default=120.0)
  parser.add_argument("--out", type=pathlib.Path, help="also write the tables to this file")
  parser.add_argument("--picture", type=pathlib.Path, help="also draw the robot's walk, wave, kick and sit")
  args = parser.parse_args()
  pipeline, robot = Pipeline(args.model), robots.load("g1")
  lines, single = [], []
  for prompt in PROMPTS:
    clip = pipeline(prompt, seed=args.seed)
    motion = followed(clip, robot)
    single.append(motion)
    lines.append(row_of(prompt, motion, robots.report(motion, clip)))
  if args.picture:
    draw([single[number] for number in SHOWN], args.picture)
  motion, clip, changes = streamed(pipeline, robot, args.seed, args.seconds)
  lines.append(row_of(f"stream, {len(changes)} changes of prompt", motion, robots.report(motion, clip)))
  order = [number % len(PROMPTS) for number in range(len(changes) + 1)]
  joined = [float(np.abs(single[b].angles[0] - single[a].angles[-1]).max()) for a, b in zip(order, order[1:])]
  seams, far = largest(motion.angles, changes), largest(motion.angles)
  columns = ["motion", "seconds", "pelvis, mm", "feet, mm", "hands, mm", "frames at a limit", "largest step, rad",
             "slide, mm/s", "in the floor, mm", "work, s/s"]
  pair = lambda values: [f"{np.median(values):.2f}", f"{max(values):.2f}"] if len(values) else ["", ""]
  text = "\n\n".join([
      f"{args.model}, seed {args.seed}, {machine.today()}, {machine.words(machine.describe())}",
      results.markdown(columns, lines),
      results.markdown(["largest step of a joint in one tick, rad", "median", "largest"], [
          ["streamed, within 0.5 s of a change of prompt", *pair(seams)],
          ["streamed, anywhere", "", f"{far:.2f}"],
          ["the same prompts generated one by one and joined", *pair(joined)]])])
  print(text)
  if args.out:
    args.out.write_text(text + "\n")


if __name__ == "__main__":
  main()
