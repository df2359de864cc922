"""The mannequin that every picture shows: tapered capsules hung on the joints, sized by the bones.

A part is the hull of two balls. It hangs on two joints and moves with the rotation of a third, so that pictures show
the joints exactly, also where bone lengths change. Metres everywhere: a skeleton's own unit ends here.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import Pose, to_pose
from motion_jax.motion.skeleton import Skeleton

# Colours by limb, sRGB 0..1: right warm, left cool, the middle neutral; joints and hands a shade darker.
COLORS = {"middle": (0.60, 0.63, 0.70), "right": (0.93, 0.46, 0.30), "left": (0.20, 0.55, 0.80),
          "head": (0.80, 0.80, 0.82), "dark": (0.33, 0.36, 0.43)}
GROUPS = tuple(COLORS)
_LEG = 0.82  # thigh and shin, metres, of the person whom the sizes below fit


class Part(NamedTuple):
  """The hull of a ball at joint a and one at joint b; the offsets turn with the joint `frame`. Metres."""
  a: int
  b: int
  a_offset: tuple
  b_offset: tuple
  frame: int
  a_radius: float
  b_radius: float
  group: str


class Figure(NamedTuple):
  """A clip ready to draw, metres, P parts: their balls a and b over time, and what the ground needs to know."""
  joints: np.ndarray  # (T, J, 3)
  pose: Pose
  parts: tuple[Part, ...]
  a: np.ndarray       # (T, P, 3)
  b: np.ndarray       # (T, P, 3)
  ahead: np.ndarray   # (T, 3) unit vectors on the ground: where the pelvis faces
  floor: float        # height of the ground


def make_figure(clip) -> Figure:
  """Poses the mannequin on every frame of a Clip."""
  skeleton = clip.skeleton
  joints = np.asarray(clip.joints, np.float64) * skeleton.unit
  pose = to_pose(joints, skeleton, clip.fps)
  parts = make_parts(skeleton, pose.offsets)
  frames = pose.turned[:, [part.frame for part in parts]]
  a, b = (joints[:, [getattr(part, end) for part in parts]]
          + rot.rotate(frames, np.array([getattr(part, end + "_offset") for part in parts])[None]) for end in "ab")
  ahead = rot.rotate(pose.turned[:, 0], np.array([0.0, 0.0, 1.0])) * [1, 0, 1]
  ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
  radius_a, radius_b = (np.array([getattr(part, end + "_radius") for part in parts]) for end in "ab")
  lowest = np.minimum(a[..., 1] - radius_a, b[..., 1] - radius_b).min(1)
  return Figure(joints, pose, parts, a, b, ahead, float(np.quantile(lowest, 0.1)))


def make_parts(skeleton: Skeleton, offsets) -> tuple[Part, ...]:
  """The parts of a body whose T-pose offsets (J, 3) are in metres."""
  names, parents = skeleton.joints, skeleton.parents
  index = {name: j for j, name in enumerate(names)}
  lengths = np.linalg.norm(offsets, axis=-1)
  s = float(lengths[list(skeleton.leg_bones)].sum()) / _LEG
  parts = []

  def add(a, b, a_radius, b_radius, group, a_offset=(0, 0, 0), b_offset=(0, 0, 0), frame=None):
    a, b = index[a], index[b]
    frame = index[frame] if frame else a
    parts.append(Part(a, b, tuple(np.multiply(a_offset, s)), tuple(np.multiply(b_offset, s)), frame,
                      a_radius * s, b_radius * s, group))

  root, neck, head = names[0], "neck", "head"
  spine = [name for name in names if name.startswith(("spine", "torso"))]
  chest = names[parents[index["left_collar"]]] if "left_collar" in index else neck
  add("left_hip", "right_hip", 0.088, 0.088, "middle", (-0.01, 0.02, -0.01), (0.01, 0.02, -0.01), frame=root)
  below = [root, *spine]
  for lower, upper, r0, r1 in zip(below, below[1:], (0.105, 0.098, 0.106), (0.098, 0.106, 0.112)):
    add(lower, upper, r0, r1, "middle", (0, 0.01, 0.005), (0, 0, 0.005))
  # The chest reaches most of the way to the shoulders; how far is the body's own affair.
  width = abs(offsets[index["left_shoulder"]] + (offsets[index["left_collar"]] if "left_collar" in index else 0))[0] / s
  rise = 0.05 if chest != neck else -0.12
  add(chest, chest, 0.108, 0.108, "middle", (-width * 0.34, rise, 0.01), (width * 0.34, rise, 0.01))
  for side, sign in (("left", 1), ("right", -1)):
    shoulder, elbow, wrist = (f"{side}_{name}" for name in ("shoulder", "elbow", "wrist"))
    hip, knee, ankle, foot = (f"{side}_{name}" for name in ("hip", "knee", "ankle", "foot"))
    add(chest, shoulder, 0.082, 0.057, "middle", (sign * width * 0.30, rise + 0.035, 0))
    add(shoulder, elbow, 0.054, 0.041, side)
    add(elbow, wrist, 0.042, 0.029, side)
    hand = (sign * 0.075, -0.006, 0.006)
    add(wrist, wrist, 0.03, 0.033, "dark", b_offset=hand)
    add(wrist, wrist, 0.033, 0.02, "dark", hand, (sign * 0.145, -0.012, 0.02))
    add(wrist, wrist, 0.022, 0.014, "dark", (sign * 0.03, 0, 0.02), (sign * 0.075, -0.005, 0.06))  # thumb
    add(hip, knee, 0.086, 0.058, side)
    add(knee, ankle, 0.057, 0.037, side)
    sole = 0.030
    add(ankle, foot, 0.042, 0.036, "dark", (0, -0.015, -0.01), (0, 0.008, -0.01))
    add(ankle, foot, 0.036, sole, "dark", (0, _heel(offsets[index[foot]], s), -0.035), frame=ankle)
    add(foot, foot, 0.034, 0.024, "dark", b_offset=(0, -0.004, 0.06))
  add(neck, head, 0.055, 0.05, "head")
  add(head, head, 0.082, 0.094, "head", (0, 0.02, 0.028), (0, 0.098, 0.004))
  add(head, head, 0.016, 0.012, "head", (0, 0.052, 0.105), (0, 0.03, 0.118))  # a nose tells front from back
  return tuple(parts)


def _heel(foot, s):
  """Height of the heel's ball below the ankle: as low as the ball of the foot."""
  return min(-0.005, float(foot[1]) / s + 0.008)


def default_colors(figure):
  """Colour (P, 3) of each part, sRGB 0..1."""
  return np.array([COLORS[part.group] for part in figure.parts])
