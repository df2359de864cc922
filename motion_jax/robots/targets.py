"""Where a robot's bodies should be: a human motion on the robot's proportions, feet standing where they stood."""
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.pose import to_pose
from motion_jax.motion.retarget import retarget
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.robots.robot import SIDES, Robot, to_robot_axes, turn_to_robot_axes

_BLEND = 0.12  # seconds in which a foot goes over to where it is held, and back


class Targets(NamedTuple):
  """Targets of T frames in a robot's axes, metres."""
  pelvis: Float[np.ndarray, "t 3"]
  turned: dict[str, Float[np.ndarray, "t 4"]]     # world rotations of pelvis, torso and both ankles
  limbs: dict[str, Float[np.ndarray, "t 3"]]      # positions of knees and ankles
  arms: dict[str, tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "t 3"]]]  # directions of upper arm and forearm
  planted: Bool[np.ndarray, "t 2"]                # whether the left and the right foot stand


class Sizes(NamedTuple):
  """A robot's proportions in its upright pose, metres."""
  hip: float
  thigh: float
  shin: float
  foot: float
  upper_arm: float
  forearm: float
  hips_below_pelvis: Float[np.ndarray, " 3"]  # from the pelvis body to the middle between the hips


def sizes_of(robot: Robot) -> Sizes:
  places, turned = robot.kinematics(robot.standing()[None])
  of = lambda part: robot.place(part, places, turned)[0]
  between = lambda a, b: float(np.mean([np.linalg.norm(of(f"{side}_{a}") - of(f"{side}_{b}")) for side in SIDES]))
  hips = (of("left_hip") + of("right_hip")) / 2
  body, sole = robot.soles()[0]
  front = places[0, body] + rot.rotate(turned[0, body][None], sole)[:, 0].max() * np.array([1, 0, 0])
  return Sizes(float(np.linalg.norm(of("left_hip") - of("right_hip"))) / 2, between("hip", "knee"),
               between("knee", "ankle"), max(float(front[0] - places[0, body][0]), 0.05),
               between("shoulder", "elbow"), between("elbow", "wrist"), hips - of("pelvis"))


def targets_of(clip: Clip, robot: Robot, fps: float) -> Targets:
  """The targets of a clip of HumanML3D's 22 joints at fps frames a second.

  Legs: the motion on the robot's leg lengths (`motion.retarget`). Arms: directions alone, since a robot's shoulders are
  elsewhere. A foot that stands is held flat on the floor in one place.
  """
  joints = np.asarray(clip.joints, np.float64)
  if clip.fps != fps and len(joints) > 1:
    joints = resample(joints, clip.fps, fps)
  sizes, names = sizes_of(robot), HUMANML3D.joints
  place = {name: names.index(name) for name in names}
  lengths = HUMANML3D.offsets * (sizes.thigh + sizes.shin) / HUMANML3D.bone_lengths[list(HUMANML3D.leg_bones)].sum()
  for side in SIDES:
    for part, length in (("knee", sizes.thigh), ("ankle", sizes.shin), ("foot", sizes.foot)):
      bone = place[f"{side}_{part}"]
      lengths[bone] *= length / np.linalg.norm(lengths[bone])
  body = retarget(joints, HUMANML3D.with_offsets(lengths))
  stands = feet_stand(body, fps, floor=0.0)
  pose = to_pose(body, fps=fps)
  turned = {"pelvis": pose.turned[:, 0], "torso": pose.turned[:, place["spine3"]]}
  turned = {part: turn_to_robot_axes(q) for part, q in turned.items()}
  world = to_robot_axes(body)
  hips = (world[:, place["left_hip"]] + world[:, place["right_hip"]]) / 2
  limbs, planted, ground = {}, [], []
  for k, side in enumerate(SIDES):
    foot = _foot(body, pose, side, stands[:, 2 * k] & stands[:, 2 * k + 1])
    turned[f"{side}_ankle"], slope = foot
    planted.append(stands[:, 2 * k] & stands[:, 2 * k + 1] & (slope < 0.35))
    limbs[f"{side}_knee"], limbs[f"{side}_ankle"] = world[:, place[f"{side}_knee"]], world[:, place[f"{side}_ankle"]]
    height = limbs[f"{side}_ankle"][:, 2]
    still = height[planted[-1]] if planted[-1].any() else height
    ground.append(float(np.percentile(still, 20)))
  # The robot's ankle is nearer to the floor than a person's: legs and pelvis go down by the difference.
  for k, side in enumerate(SIDES):
    sole = robot.soles()[k][1]
    bottom = -rot.rotate(turned[f"{side}_ankle"][:, None], sole[None])[..., 2].min(1)
    ankle = limbs[f"{side}_ankle"]
    lowered = ankle[:, 2] - ground[k] - sole[:, 2].min()
    ankle = np.stack([ankle[:, 0], ankle[:, 1], np.maximum(lowered, bottom)], axis=-1)
    ankle[planted[k], 2] = -sole[:, 2].min()
    limbs[f"{side}_ankle"], turned[f"{side}_ankle"] = _held(ankle, turned[f"{side}_ankle"], planted[k], fps)
    limbs[f"{side}_knee"] = limbs[f"{side}_knee"] - [0, 0, ground[k] + sole[:, 2].min()]
  drop = np.mean(ground) + np.mean([sole[:, 2].min() for _, sole in robot.soles()])
  pelvis = hips - rot.rotate(turned["pelvis"], np.broadcast_to(sizes.hips_below_pelvis, hips.shape)) - [0, 0, drop]
  directions = lambda a, b: rot.unit(world[:, place[b]] - world[:, place[a]], eps=1e-9)
  arms = {side: (directions(f"{side}_shoulder", f"{side}_elbow"), directions(f"{side}_elbow", f"{side}_wrist"))
          for side in SIDES}
  return Targets(pelvis, turned, limbs, arms, np.stack(planted, axis=1))


def _foot(body, pose, side, stands):
  """(rotation (T, 4) of a foot that is level where it stands, |slope| (T,) from there in radians) in a robot's axes."""
  ankle, toes = (HUMANML3D.joints.index(f"{side}_{part}") for part in ("ankle", "foot"))
  bone = body[:, toes] - body[:, ankle]
  slope = np.arctan2(-bone[:, 1], np.linalg.norm(bone[:, ::2], axis=-1))
  level = float(np.median(slope[stands])) if stands.any() else float(np.percentile(slope, 25))
  rest = pose.offsets[toes]
  steep = np.arctan2(-rest[1], np.linalg.norm(rest[::2]))
  turn = rot.about_axis(np.full(len(body), steep - level), "x")
  return turn_to_robot_axes(rot.multiply(pose.turned[:, ankle], turn)), np.abs(slope - level)


def _held(place, turned, planted, fps):
  """Place (T, 3) and rotation (T, 4) of a foot that stays flat and where it is on average while it is planted."""
  held, flat, weight = place.copy(), turned.copy(), planted.astype(float)
  edges = np.flatnonzero(np.diff(np.concatenate([[0], planted.astype(int), [0]])))
  reach = max(int(round(_BLEND * fps)), 1)
  for first, past in zip(edges[::2], edges[1::2]):
    ahead = rot.rotate(turned[first:past], np.broadcast_to([1.0, 0, 0], (past - first, 3))).mean(0)
    yaw = np.arctan2(ahead[1], ahead[0])
    low, high = max(first - reach, 0), min(past + reach, len(place))
    span = np.arange(low, high)
    share = np.clip(1 - np.maximum(first - span, span - past + 1) / (reach + 1), 0, 1)
    wins = share >= weight[low:high] if (first or past < len(place)) else np.ones(len(span), bool)
    span, share = span[wins], share[wins]
    weight[span] = share
    held[span, :2] = place[first:past, :2].mean(0)
    flat[span] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
  smooth = (weight * weight * (3 - 2 * weight))[:, None]
  moved = place.copy()
  moved[:, :2] += smooth * (held - place)[:, :2]
  return moved, rot.slerp(turned, flat, smooth[:, 0])
