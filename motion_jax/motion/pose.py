"""Inverse kinematics of clips: joint positions to one rotation per joint, relative to its parent, from a T-pose.

Positions define the direction of bones but not their twist, which is chosen anatomically: the pelvis by its hip and
spine bones, the chest by the neck and collar bones, the spine in between by both; upper arms and thighs by elbows and
knees as hinges (a straight leg by its foot); every other joint turns as little as possible from its parent. Rotations
change smoothly in time, over any number of whole turns of the body.
"""
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import (
  HUMANML3D,
  THIN,
  Skeleton,
  body_axes,
  from_nearest,
  side_and_kind,
  t_pose,
  unit_or_nearest,
)
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Array, Float, Num

Tree = list[list[int]]  # the children of each joint

# A comfortable direction of the bone below the joint. No limb can point the opposite way, so turns are unambiguous.
_EASY = {"shoulder": (0.45, -0.55, 0.7), "hip": (0.1, -0.85, 0.5)}
_HINGES = {"shoulder": (0, -1, 0), "hip": (1, 0, 0)}  # axis of elbow and knee in the T-pose, again for the left side
TIPS = {"head": (0, 0.18, 0.02), "wrist": (0.17, 0, 0), "foot": (0, 0, 0.07)}  # ends of limbs, metres; x for the left
_BENDS = {"foot": ((-1, 0, 0), 60), "wrist": ((0, 0, 1), 80)}  # hinge by which a tip bends up, and how far, degrees
_LONGEST = 100_000  # frames: more than an hour at 20 a second, a gigabyte
_SECONDS = 0.12  # time scale of the smoothing of twists
_UNTWISTED = 0.08  # weight of the prior that a limb is not twisted
_TWIST_SPEED, _TWIST_PRICE = 8.0, 0.05  # largest twist speed, radians a second; cost of twisting relative to evidence


class Pose(NamedTuple):
  """A moving skeleton: offsets, root path and joint rotations, in the unit of the source joints."""
  offsets: Float[np.ndarray, "j 3"]      # from the parent, in the T-pose; the root's is zero
  shifts: Float[np.ndarray, "t j 3"]     # added to the offset: the residual that rotations cannot express
  root: Float[np.ndarray, "t 3"]         # position of the root
  rotations: Float[np.ndarray, "t j 4"]  # quaternions (w, x, y, z) relative to the parent; signs continuous in time
  turned: Float[np.ndarray, "t j 4"]     # the same in the world


def to_pose(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D, fps: float = 20.0,
            rest: Float[np.ndarray, "j 3"] | None = None) -> Pose:
  """Joints (T, J, 3) to the rotations of a T-pose skeleton with offsets rest (J, 3), by default the clip's mean bones.

  Every bone keeps its direction, so `pose_to_joints` restores the joints if bone lengths are constant. A joint with
  several children (pelvis, chest) has one rotation; how its bones move against each other, which is nothing in most
  captures, is left in `shifts`. With `rest` given, so is any other difference from the rest bones. float64.
  """
  if len(joints) > _LONGEST:
    raise ValueError(f"got {len(joints):,} frames to draw or to turn into angles, expected at most {_LONGEST:,}; cut "
                     "the motion in parts, .npz and .npy hold any length")
  joints = np.asarray(joints, np.float64)
  parents, children = skeleton.parents, skeleton.children
  lengths = np.linalg.norm(joints - joints[:, np.maximum(parents, 0)], axis=-1).mean(0)
  offsets = t_pose(skeleton, lengths) if rest is None else np.array(rest, np.float64)
  bones = joints - joints[:, np.maximum(parents, 0)]
  turned: list = [None] * skeleton.num_joints
  shifts = np.zeros_like(joints)
  for joint in skeleton.order:
    if len(members := children[joint]) > 1:
      turned[joint], shape = _fit(joints, bones, joint, members, skeleton)
      if rest is not None:
        turned[joint] = rot.multiply(turned[joint], _turn_to_rest(shape, offsets[members], 0.1 * lengths.mean()))
        continue
      offsets[members] = shape
      local = rot.rotate(rot.conjugate(turned[joint])[:, None], bones[:, members])
      shifts[:, members] = local - offsets[members]
      for member in members:
        # The collar of a figure without collars has no length: its shoulder rests at its mean position.
        if lengths[member] < 1e-3 * lengths.sum() and children[member]:
          child = children[member][0]
          offsets[child] = lengths[child] * rot.unit(
              rot.rotate(rot.conjugate(turned[joint]), bones[:, child]).mean(0), eps=1e-9)
  if "head" in skeleton.joints and rest is None:
    head = skeleton.joints.index("head")
    chest = next(turned[j] for j in _ancestors(head, parents) if turned[j] is not None)
    offsets[head] = _mean_head_direction(chest, bones[:, head]) * lengths[head]
  for joint in skeleton.order:
    if turned[joint] is not None:
      continue
    above = turned[parents[joint]]
    if not children[joint]:
      turned[joint] = above  # the end of a limb has no child bone that would define its rotation
      continue
    child, (_, kind) = children[joint][0], side_and_kind(skeleton.joints[joint])
    if kind in _HINGES:
      turned[joint] = _hinge_turn(joint, bones, offsets, above, children, skeleton, fps)
    else:
      if (ahead := _next_branch(joint, children)) is not None:  # part of the spine's turn to the chest
        below, steps = ahead
        above = rot.slerp(above, turned[below], np.full(len(joints), 1 / (steps + 1)))
      turned[joint] = _swing(above, offsets[child], bones[:, child])
  local = [turn if parent < 0 else rot.multiply(rot.conjugate(turned[parent]), turn)
           for turn, parent in zip(turned, parents)]
  if rest is not None:
    above = np.stack([turned[max(parent, 0)] for parent in parents], axis=1)
    shifts = rot.rotate(rot.conjugate(above), bones) - offsets
  local, world = (rot.continuous(rot.unit(np.stack(q, axis=1))) for q in (local, turned))
  return Pose(offsets, shifts, joints[:, 0].copy(), local, world)


def _turn_to_rest(shape: Float[np.ndarray, "n 3"], offsets: Float[np.ndarray, "n 3"], firmness: float
                  ) -> Float[np.ndarray, "_ 4"]:
  """The turn, by least squares, between the bones of a clip and those of a rig; a shape of no width leaves it at 0."""
  firm = firmness * np.eye(3)
  return rot.from_matrix(rot.best_turn(np.concatenate([shape, firm])[None], np.concatenate([offsets, firm])))


def _mean_head_direction(chest: Float[np.ndarray, "t 4"], bone: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, " 3"]:
  """Direction of the head in a T-pose: necks differ between captures, so it is the average of the clip."""
  _, y, z = rot.rotate(rot.conjugate(chest), bone).mean(0)
  tilt = np.clip(np.arctan2(z, y), -0.1, 0.7)
  return np.array([0, np.cos(tilt), np.sin(tilt)])


def pose_to_joints(pose: Pose, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "t j 3"]:
  """Forward kinematics: joints (T, J, 3) of a pose."""
  joints, turned = np.empty(pose.rotations.shape[:2] + (3,)), pose.rotations.copy()
  joints[:, 0] = pose.root
  for joint in skeleton.order[1:]:
    parent = skeleton.parents[joint]
    turned[:, joint] = rot.multiply(turned[:, parent], pose.rotations[:, joint])
    joints[:, joint] = joints[:, parent] + rot.rotate(turned[:, parent], pose.offsets[joint] + pose.shifts[:, joint])
  return joints


def turn_ends(pose: Pose, joints: Float[np.ndarray, "t j 3"], skeleton: Skeleton = HUMANML3D,
              level: float | None = None) -> Pose:
  """The pose with toes and hands bent up where they would be below the ground.

  No joint defines the rotation of the end of a limb, but the ground does: toes stay on it while the foot rolls over
  them. A tip that would be below the level of standing toes bends up about the joint's hinge as far as needed. In the
  air, and at the head, ends stay straight. joints (T, J, 3): metres; level: height of standing toes, by default the 5th
  percentile of the lower foot in this motion.
  """
  feet = [j for j, name in enumerate(skeleton.joints) if name.endswith("foot")]
  level = np.percentile(joints[:, feet, 1].min(1), 5) if level is None else level
  local, world = pose.rotations.copy(), pose.turned.copy()
  for joint, name in enumerate(skeleton.joints):
    side, kind = side_and_kind(name)
    if kind not in _BENDS:
      continue
    axis, most = np.array(_BENDS[kind][0], np.float64) * (side if kind == "wrist" else 1), np.radians(_BENDS[kind][1])
    tip = np.array(TIPS[kind]) * [side, 1, 1]
    down = np.clip(level - joints[:, joint, 1], -np.linalg.norm(tip), 0)
    across = rot.rotate(world[:, joint], np.cross(axis, tip))[:, 1]
    along = rot.rotate(world[:, joint], tip)[:, 1]
    # The tip's height is a cosine of the angle that it bends by; the first angle at which it is high enough.
    height = np.maximum(np.hypot(along, across), 1e-9)
    angle = np.where(along < down, np.arctan2(across, along) - np.arccos(np.clip(down / height, -1, 1)), 0)
    half = np.clip(angle, 0, most)[:, None] / 2
    turn = np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1)
    local[:, joint], world[:, joint] = rot.multiply(local[:, joint], turn), rot.multiply(world[:, joint], turn)
  return pose._replace(rotations=rot.continuous(local), turned=rot.continuous(world))



def _ancestors(joint: int, parents: Sequence[int]) -> Iterator[int]:
  while (joint := parents[joint]) >= 0:
    yield joint



def _next_branch(joint: int, children: Tree) -> tuple[int, int] | None:
  """(the next joint with several children, bones to there) down an unbranched chain; None if it only ends."""
  steps = 0
  while len(children[joint]) == 1:
    joint, steps = children[joint][0], steps + 1
  return (joint, steps) if children[joint] else None


def _fit(joints: Float[np.ndarray, "t j 3"], bones: Float[np.ndarray, "t j 3"], joint: int, members: list[int],
         skeleton: Skeleton) -> tuple[Float[np.ndarray, "t 4"], Float[np.ndarray, "c 3"]]:
  """Rotations (T, 4) of a joint with several children, and the children's offsets (C, 3), by least squares.

  First axes from the line between the left and the right child and the remaining child, then the mean shape in these
  axes, then the rotation that fits this shape best in each frame (Kabsch). Children in one point or on one line define
  no rotation: then hips, shoulders and trunk do (`skeleton.body_axes`).
  """
  names = [skeleton.joints[j] for j in members]
  sides = [side_and_kind(name)[0] if name.startswith(("left", "right")) else 0 for name in names]
  left, right, middle = (members[sides.index(side)] for side in (1, -1, 0))
  group = bones[:, members]
  up = bones[:, middle] - (bones[:, left] + bones[:, right]) * (0.5 if skeleton.joints[middle] != "neck" else 0)
  x = unit_or_nearest(bones[:, left] - bones[:, right])
  ahead = np.cross(x, up)
  thin = THIN * np.median(np.linalg.norm(bones[:, list(skeleton.leg_bones)], axis=-1).sum(-1))
  width, height = (np.linalg.norm(v, axis=-1) for v in (bones[:, left] - bones[:, right], ahead))
  if min(np.median(width), np.median(height)) > thin:
    z = unit_or_nearest(ahead)
    frame = np.stack([x, np.cross(z, x), z], axis=-1)
    shape = np.einsum("tji,tcj->ci", frame, group) / len(bones)
    frame = from_nearest(rot.best_turn(group, shape), np.minimum(width, height) > 1e-6 * thin)
  else:
    frame = body_axes(joints, skeleton)[int(joint != 0)]
  shape = np.einsum("tji,tcj->ci", frame, group) / len(bones)
  return rot.from_matrix(frame), shape


def _swing(turn: Float[np.ndarray, "t 4"], rest: Float[np.ndarray, "3"], bone: Float[np.ndarray, "t 3"]
           ) -> Float[np.ndarray, "t 4"]:
  """`turn` (T, 4) followed by the smallest rotation that brings rest (3,) onto the direction of bone (T, 3)."""
  if np.linalg.norm(rest) < 1e-9:
    return turn
  now, length = rot.unit(rot.rotate(turn, rest)), np.linalg.norm(bone, axis=-1, keepdims=True)
  goal = np.where(length > 1e-9, bone / np.maximum(length, 1e-9), now)
  opposed = (now * goal).sum(-1, keepdims=True) < -1 + 1e-9
  aside = np.cross(rest, np.eye(3)[np.abs(rest).argmin()])  # perpendicular to the bone; turns with the body
  goal = np.where(opposed, rot.unit(goal + 1e-3 * rot.rotate(turn, aside)), goal)
  return rot.multiply(rot.between(now, goal), turn)


def _hinge_turn(joint: int, bones: Float[np.ndarray, "t j 3"], offsets: Float[np.ndarray, "j 3"],
                above: Float[np.ndarray, "t 4"], children: Tree, skeleton: Skeleton, fps: float
                ) -> Float[np.ndarray, "t 4"]:
  """Rotations (T, 4) of a shoulder or hip: exact for its bone, twisted by the hinge of elbow or knee where it bends."""
  side, kind = side_and_kind(skeleton.joints[joint])
  child = children[joint][0]
  mirror = np.array([side, 1, 1])
  axis = np.array(_HINGES[kind], np.float64) * (side if kind == "shoulder" else 1)
  rest, easy = rot.unit(t_pose(skeleton)[child]), rot.unit(np.array(_EASY[kind]) * mirror)
  turn = _swing(rot.multiply(above, rot.between(rest, easy)[None]), rest, bones[:, child])
  bone = rot.rotate(turn, rest)
  if not children[child]:
    return turn
  lower = rot.unit(bones[:, children[child][0]], eps=1e-9)  # zero if it has no length: then no evidence of a hinge
  evidence = _angle_evidence(turn, bone, axis, np.cross(bone, lower))
  end = children[children[child][0]]
  if kind == "hip" and end:
    foot = rot.unit(bones[:, end[-1]], eps=1e-9)
    evidence = evidence + 0.3 * _angle_evidence(turn, bone, axis, np.cross(foot, lower))
  twist = _smooth_twist(evidence + np.array([_UNTWISTED, 0]), _own_twist(turn, above, rest), fps)
  return rot.multiply(turn, np.concatenate([np.cos(twist / 2)[:, None], np.sin(twist / 2)[:, None] * rest], axis=-1))


def _own_twist(turn: Float[np.ndarray, "t 4"], above: Float[np.ndarray, "t 4"], rest: Float[np.ndarray, "3"]
               ) -> Float[np.ndarray, " t"]:
  """Accumulated twist (T,), radians, of rotations `turn` (T, 4) about the bone `rest` (3,), relative to the parent."""
  local = rot.multiply(rot.conjugate(above), turn)
  step = rot.multiply(rot.conjugate(local[:-1]), local[1:])
  angle = 2 * np.arctan2(step[:, 1:] @ rest, step[:, 0])
  return np.cumsum(np.append(0.0, (angle + np.pi) % (2 * np.pi) - np.pi))


def _smooth_twist(evidence: Float[np.ndarray, "t 2"], measured: Float[np.ndarray, " t"], fps: float
                  ) -> Float[np.ndarray, " t"]:
  """Angles (T,) to add to the measured twist (T,) of a limb: near those of evidence (T, 2), but smooth in time.

  The cheapest path over a circle of angles, by dynamic programming. Evidence that flips between frames, as for a nearly
  straight limb, is ignored where following it would be a jump.
  """
  num, reach = 72, max(1, round(_TWIST_SPEED / fps / (2 * np.pi / 72)))
  angles = np.arange(num) * 2 * np.pi / num
  target, weight = np.arctan2(evidence[:, 1], evidence[:, 0]) + measured, np.linalg.norm(evidence, axis=-1)
  price = weight[:, None] * (1 - np.cos(angles - target[:, None]))
  steps = np.arange(-reach, reach + 1)
  change = _TWIST_PRICE * fps * (steps * 2 * np.pi / num) ** 2
  source = (np.arange(num) - steps[:, None]) % num
  before, total = np.empty((len(measured), num), int), price[0]
  for t in range(1, len(measured)):
    costs = total[source] + change[:, None]
    before[t] = steps[costs.argmin(0)]
    total = costs.min(0) + price[t]
  path = np.empty(len(measured))
  at = int(total.argmin())
  place = float(at)
  for t in range(len(measured) - 1, -1, -1):
    path[t] = place
    if t:
      step = before[t, at]
      at, place = (at - step) % num, place - step
  return gaussian_filter1d(path * 2 * np.pi / num, _SECONDS / 2 * fps, mode="nearest") - measured


def _angle_evidence(turn: Float[np.ndarray, "t 4"], bone: Float[np.ndarray, "t 3"], axis: Float[np.ndarray, "3"],
                    normal: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 2"]:
  """Cosine and sine (T, 2) of the angle about the bone from the hinge axis to the normal, times the squared length of
  the normal: a nearly straight limb gives little evidence of its hinge."""
  before = rot.rotate(turn, axis)
  parts = np.stack([(before * normal).sum(-1), (np.cross(bone, before) * normal).sum(-1)], axis=-1)
  return parts * np.linalg.norm(normal, axis=-1, keepdims=True)
