"""How well a robot follows a motion: errors in millimetres and radians, limits, foot sliding, steps between two ticks.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.robot import SIDES
from motion_jax.robots.targets import sizes_of, targets_of

NEAR = 0.005  # radians from a limit that count as reaching it


class Report(NamedTuple):
  """Distances in millimetres, (mean, largest); angles in radians."""
  pelvis: tuple[float, float]
  feet: tuple[float, float]
  hands: tuple[float, float]
  at_limit: float          # share of frames in which a joint is at a limit
  limits: dict[str, float]  # {joint: share of frames at a limit}, where not 0
  largest_step: float      # radians of a joint between two ticks
  step_joint: str
  slide: float             # millimetres a second of a planted sole, mean
  in_floor: float          # millimetres of the deepest sole under the floor
  seams: tuple[float, ...]  # radians: largest step around each change of prompt

  def lines(self) -> list[str]:
    """The report as lines of text."""
    pair = lambda values: f"{values[0]:.0f} mm, at most {values[1]:.0f}"
    limits = ", ".join(f"{name.removesuffix('_joint')} {100 * share:.0f} %" for name, share in self.limits.items())
    lines = [f"pelvis {pair(self.pelvis)}; feet {pair(self.feet)}; hands {pair(self.hands)}",
             f"largest step of a joint {self.largest_step:.3f} rad a tick ({self.step_joint.removesuffix('_joint')})",
             f"planted soles slide {self.slide:.1f} mm/s; deepest in the floor {self.in_floor:.1f} mm",
             f"at a limit: {limits or 'no joint'}"]
    if self.seams:
      lines.append("largest step where prompts change: " + ", ".join(f"{seam:.3f}" for seam in self.seams) + " rad")
    return lines


def of(motion: RobotMotion, clip) -> Report:
  """The report of a motion that `retargeting.retarget` made of a clip."""
  robot = motion.robot
  targets = motion.targets if motion.targets and clip is motion.human else targets_of(clip, robot, motion.fps)
  places, turned = robot.kinematics(motion.qpos)
  at = lambda part: robot.place(part, places, turned)
  distance = lambda *pairs: 1000 * np.linalg.norm(np.stack([a - b for a, b in pairs]), axis=-1)
  planted = np.stack([target.planted for target in targets])
  goal = lambda part: np.stack([target.limbs[part] for target in targets])
  pair = lambda values: (float(values.mean()), float(values.max()))
  hands = [(at(f"{side}_wrist"), at(f"{side}_shoulder") + _arm(targets, side, robot)) for side in SIDES]
  soles = [places[:, body, None] + rot.rotate(turned[:, body, None], sole[None]) for body, sole in robot.soles()]
  steps = np.abs(np.diff(motion.angles, axis=0))
  ranges = robot.ranges
  near = (motion.angles - ranges[:, 0] < NEAR) | (ranges[:, 1] - motion.angles < NEAR)
  near[:, [robot.joints.index(name) for name in robot.fixed]] = False
  limits = {name: float(share) for name, share in zip(robot.joints, near.mean(0)) if share > 0}
  changes = [int(caption.start * motion.fps) for caption in motion.captions[1:] if caption.start]
  around = [steps[max(frame - 10, 0):frame + 10] for frame in changes]
  return Report(
      pair(distance((at("pelvis"), np.stack([target.pelvis for target in targets])))),
      pair(distance(*((at(f"{side}_ankle"), goal(f"{side}_ankle")) for side in SIDES))),
      pair(distance(*hands)), float(near.any(1).mean()), dict(sorted(limits.items(), key=lambda item: -item[1])),
      float(steps.max()) if steps.size else 0.0, robot.joints[int(steps.max(0).argmax())] if steps.size else "",
      _slide(soles, planted, motion.fps), 1000 * max(0.0, -float(min(sole[..., 2].min() for sole in soles))),
      tuple(float(part.max()) for part in around if part.size))


def _arm(targets, side, robot):
  sizes = sizes_of(robot)
  upper, fore = (np.stack(rows) for rows in zip(*(target.arms[side] for target in targets)))
  return sizes.upper_arm * upper + sizes.forearm * fore


def _slide(soles, planted, fps):
  """The mean speed, millimetres a second, at which soles (T, N, 3) move while they are planted in two frames."""
  speeds = []
  for sole, stands in zip(soles, planted.T):
    step = np.linalg.norm(np.diff(sole.mean(1)[:, :2], axis=0), axis=-1) * fps * 1000
    speeds.append(step[stands[1:] & stands[:-1]])
  all_speeds = np.concatenate(speeds)
  return float(all_speeds.mean()) if len(all_speeds) else 0.0
