"""The mannequin of all pictures: tapered capsules attached to the joints, sized by the bones.

A part is the hull of two balls. It is attached to two joints and turns with a third, so that pictures show the joints
exactly, also where bone lengths change. All lengths are metres, whatever the skeleton's unit.
"""
import numpy as np

from motion_jax.motion import plausibility
from motion_jax.motion import rotations as rot
from motion_jax.motion.figure import COLORS, BodyPart, Figure
from motion_jax.motion.pose import Pose, pose_to_joints, to_pose, turn_ends
from motion_jax.motion.skeleton import Skeleton

_LEG = 0.82  # thigh and shin, metres, of the person whom the sizes below fit
_SOLE = 0.06  # metres (of the person above) by which a foot's balls may be raised: soles, and toes that roll off
_AT_ZERO = (-0.1, 0.25)  # metres: a body whose lowest point is outside has its ground elsewhere


def make_figure(clip, pose: Pose | None = None) -> Figure:
  """Poses the mannequin on every frame of a Clip, its soles as thick as its feet stand high.

  pose: the clip's own bones by default; another, in metres, is shown where its joints are. A motion that is no Clip
  and has a method `figure`, as a robot's, is drawn as that.
  """
  if hasattr(clip, "figure"):
    return clip.figure()
  skeleton = clip.skeleton
  if pose is None:
    joints = np.asarray(clip.joints, np.float64) * skeleton.unit
    pose = turn_ends(to_pose(joints, skeleton, clip.fps), joints, skeleton)
  else:
    joints = pose_to_joints(pose, skeleton)
  parts = _shod(make_parts(skeleton, pose.offsets), joints, pose.turned, skeleton)
  a, b = (_balls(parts, end, joints, pose.turned) for end in "ab")
  ahead = rot.rotate(pose.turned[:, 0], np.array([0.0, 0.0, 1.0])) * [1, 0, 1]
  ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
  radius_a, radius_b = (np.array([getattr(part, end + "_radius") for part in parts]) for end in "ab")
  lowest = np.minimum(a[..., 1] - radius_a, b[..., 1] - radius_b).min(1)
  stands = float(np.quantile(lowest, 0.1))
  floor = 0.0 if _AT_ZERO[0] < stands < _AT_ZERO[1] else stands
  return Figure(skeleton, joints, pose, parts, a, b, ahead, floor)


def _balls(parts, end, joints, turned):
  """Centres (T, P, 3) of the parts' balls a or b."""
  offsets = np.array([getattr(part, end + "_offset") for part in parts])
  return joints[:, [getattr(part, end) for part in parts]] + rot.rotate(turned[:, [p.frame for p in parts]],
                                                                        offsets[None])


def _shod(parts, joints, turned, skeleton):
  """The parts with the balls of the feet raised until they stand on y = 0, none further than a sole is thick.

  Where the toe joint is above the ground differs: HumanML3D's rule, and so a model's motion, puts the lowest joint of a
  clip on y = 0, in a capture it stands up to 5 cm high. The sole makes up for it, so that the mesh touches the ground
  that the joints have, and nothing has to move the motion or the ground.
  """
  raised = {}
  feet = {j for j, name in enumerate(skeleton.joints) if name.endswith(("ankle", "foot", "heel"))}
  for end in "ab":
    low = _balls(parts, end, joints, turned)[..., 1] - [getattr(part, end + "_radius") for part in parts]
    for number, part in enumerate(parts):
      if getattr(part, end) in feet and part.frame in feet:
        # Left and right alike; a tiptoe now and then may sink by what 2 % of the frames do.
        kind = (end, part.a_radius, part.b_radius, part.b_offset[1:])
        raised.setdefault(kind, []).append((number, low[:, number]))
  parts = list(parts)
  size = _size(skeleton, np.linalg.norm(joints - joints[:, np.maximum(skeleton.parents, 0)], axis=-1).mean(0))
  for (end, *_), members in raised.items():
    sunk = -np.quantile(np.concatenate([heights for _, heights in members]), 0.02)
    lift = float(np.clip(sunk, 0, _SOLE * size))
    for number, _ in members:
      x, y, z = getattr(parts[number], end + "_offset")
      parts[number] = parts[number]._replace(**{end + "_offset": (x, y + lift, z)})
  return tuple(parts)


def _size(skeleton, lengths):
  """The size of a body with bones of lengths (J,), metres, relative to the person of `_LEG`."""
  return max(0.2, float(lengths[list(skeleton.leg_bones)].sum()) / _LEG)


def make_parts(skeleton: Skeleton, offsets) -> tuple[BodyPart, ...]:
  """The parts of a body whose T-pose offsets (J, 3) are in metres."""
  names, parents = skeleton.joints, skeleton.parents
  index = {name: j for j, name in enumerate(names)}
  lengths = np.linalg.norm(offsets, axis=-1)
  plausibility.check_bones(lengths, skeleton)
  s = _size(skeleton, lengths)
  parts = []

  def add(a, b, a_radius, b_radius, group, a_offset=(0, 0, 0), b_offset=(0, 0, 0), frame=None):
    a, b = index[a], index[b]
    frame = index[frame] if frame else a
    parts.append(BodyPart(a, b, tuple(np.multiply(a_offset, s)), tuple(np.multiply(b_offset, s)), frame,
                      a_radius * s, b_radius * s, group))

  root, neck, head = names[0], "neck", "head"
  spine = [name for name in names if name.startswith(("spine", "torso"))]
  chest = names[parents[index["left_collar"]]] if "left_collar" in index else neck
  waist = spine[min(1, len(spine) - 1)]
  # The chest reaches most of the way to the shoulders; how far is the body's own affair.
  shoulder = offsets[index["left_shoulder"]] + (offsets[index["left_collar"]] if "left_collar" in index else 0)
  width = abs(shoulder[0]) / s
  rise = shoulder[1] / s - 0.065
  add("left_hip", "right_hip", 0.088, 0.088, "middle", (-0.008, 0.03, -0.008), (0.008, 0.03, -0.008), frame=root)
  add("left_hip", "right_hip", 0.078, 0.078, "middle", (-0.018, -0.005, -0.03), (0.018, -0.005, -0.03), frame=root)
  add(root, waist, 0.098, 0.092, "middle", (0, 0.02, 0), (0, 0, 0.004))
  add(waist, chest, 0.092, 0.094, "middle", (0, 0, 0.004), (0, rise - 0.01, 0.004), frame=chest)  # fills the furrow
  add(chest, neck, 0.080, 0.052, "middle", (0, min(rise, 0.04) - 0.01, -0.004), (0, -0.03, -0.006))
  for sign in (1, -1):
    add(root, waist, 0.088, 0.084, "middle", (sign * 0.055, 0.03, -0.002), (sign * 0.036, 0, 0.003))
    add(waist, chest, 0.084, 0.088, "middle", (sign * 0.036, 0, 0.003), (sign * width * 0.33, rise - 0.055, 0.0),
        frame=chest)
    add(chest, chest, 0.088, 0.072, "middle", (sign * width * 0.33, rise - 0.055, 0), (sign * width * 0.42, rise, 0))
    add(chest, chest, 0.058, 0.054, "middle", (sign * width * 0.18, rise - 0.03, 0.048),
        (sign * width * 0.38, rise - 0.012, 0.038))  # the front of the chest
  for side, sign in (("left", 1), ("right", -1)):
    shoulder, elbow, wrist = (f"{side}_{name}" for name in ("shoulder", "elbow", "wrist"))
    hip, knee, ankle, foot = (f"{side}_{name}" for name in ("hip", "knee", "ankle", "foot"))
    add(chest, shoulder, 0.072, 0.053, "middle", (sign * width * 0.42, rise, 0), (sign * -0.012, -0.002, 0))
    # From neck to shoulder, as far up as the neck stands above the shoulders.
    add(neck, shoulder, 0.047, 0.042, "middle", (sign * 0.020, -0.022, -0.012), (sign * -0.045, 0.016, -0.006),
        frame=chest)
    add(shoulder, elbow, 0.053, 0.035, side)
    add(shoulder, shoulder, 0.042, 0.035, side, (sign * 0.08, -0.004, 0.004), (sign * 0.17, -0.002, 0.006))
    add(elbow, wrist, 0.035, 0.023, side)
    add(elbow, elbow, 0.033, 0.027, side, (sign * 0.03, 0, 0.002), (sign * 0.12, 0, 0.002))
    for z in (0.016, -0.014):
      add(wrist, wrist, 0.022, 0.0175, "dark", (sign * 0.008, 0, z * 0.6), (sign * 0.085, -0.004, z * 1.4))
    for z, length in ((0.033, 0.160), (0.011, 0.174), (-0.011, 0.167), (-0.031, 0.148)):  # fingers, hardly bent
      add(wrist, wrist, 0.0125, 0.0125, "dark", (sign * 0.075, -0.003, z), (sign * length * 0.72, -0.008, z * 1.12))
      add(wrist, wrist, 0.0125, 0.009, "dark", (sign * length * 0.72, -0.008, z * 1.12),
          (sign * length, -0.024, z * 1.1))
    add(wrist, wrist, 0.019, 0.011, "dark", (sign * 0.025, -0.006, 0.022), (sign * 0.088, -0.02, 0.066))  # thumb
    add(hip, knee, 0.082, 0.051, side, (0, -0.03, -0.004))
    add(hip, hip, 0.070, 0.050, side, (0, -0.08, 0.008), (0, -0.28, 0.012))
    add(knee, ankle, 0.047, 0.032, side)
    add(knee, knee, 0.040, 0.026, side, (0, -0.07, -0.022), (0, -0.22, -0.012))
    sole = 0.030
    add(ankle, foot, 0.037, 0.034, "dark", (0, -0.01, -0.008), (0, 0.010, -0.015))
    add(ankle, foot, 0.037, sole, "dark", (0, _heel(offsets[index[foot]], s), -0.04), frame=ankle)
    for inward, reach in ((-0.014, 0.068), (0.016, 0.050)):
      add(foot, foot, 0.035, 0.023, "dark", (sign * inward, 0, 0), (sign * inward * 0.8, -0.004, reach))
  add(neck, head, 0.056, 0.054, "head", (0, -0.01, -0.004))
  add(head, head, 0.084, 0.082, "head", (0, 0.104, -0.020), (0, 0.100, 0.016))
  add(head, head, 0.054, 0.071, "head", (0, 0.0, 0.042), (0, 0.075, 0.026))
  add(head, head, 0.026, 0.040, "head", (0, -0.028, 0.074), (0, 0.0, 0.058))  # the chin
  add(head, head, 0.010, 0.015, "head", (0, 0.078, 0.098), (0, 0.040, 0.106))  # a nose tells front from back
  for sign in (1, -1):
    add(head, head, 0.011, 0.014, "head", (sign * 0.076, 0.035, 0.0), (sign * 0.080, 0.068, -0.010))  # ears
  return tuple(parts)


def _heel(foot, s):
  """Height of the heel's ball below the ankle: as low as the ball of the foot."""
  return min(-0.005, float(foot[1]) / s + 0.008)


def default_colors(figure):
  """Colour (P, 3) of each part, sRGB 0..1."""
  return np.array([COLORS[part.group] for part in figure.parts])
