"""Targets of a robot's bodies: human joints on the robot's proportions, feet standing where they stood.

Frames come one after another and every target depends only on frames up to DELAY seconds after it, so that a live
stream and a whole clip give the same numbers.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.retarget import bend, floor_height, knee_side, retarget
from motion_jax.motion.skeleton import HUMANML3D, body_axes, bone_lengths
from motion_jax.robots.robot import SIDES, Robot, to_robot_axes, turn_to_robot_axes
from motion_jax.shapes import Bool, Float, Num

DELAY = 0.4         # seconds that a target needs to see of what comes after it, at 20 frames a second in
_BLEND = 0.12       # seconds in which a foot is blended to the place where it stands, and back
_WINDOW = 0.18      # seconds before and after a frame that say whether a foot stands in it
_LEVEL = 0.65       # radians that the line from ankle to toes falls in a foot that stands flat
_ANKLE = 0.088      # metres of the ankle over the floor in a foot of HumanML3D's size that stands flat
_FLAT = 0.35        # radians that a foot which stands may be off level
_CANONICAL = 0.01   # metres by which bones of HumanML3D's own body may be off
_LEGS = [[HUMANML3D.joints.index(f"{side}_{part}") for part in ("hip", "knee", "ankle", "foot")] for side in SIDES]
_ARMS = [[HUMANML3D.joints.index(f"{side}_{part}") for part in ("shoulder", "elbow", "wrist")] for side in SIDES]


class Target(NamedTuple):
  """Targets of one frame in a robot's axes, metres."""
  pelvis: Float[np.ndarray, " 3"]
  turned: dict[str, Float[np.ndarray, " 4"]]  # world rotations of pelvis, torso and both ankles
  limbs: dict[str, Float[np.ndarray, " 3"]]   # positions of knees and ankles
  arms: dict[str, tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]]  # directions of upper arm and forearm
  planted: Bool[np.ndarray, " 2"]             # whether the left and the right foot stand


class Sizes(NamedTuple):
  """A robot's proportions in its upright pose, metres."""
  hip: float
  thigh: float
  shin: float
  upper_arm: float
  forearm: float
  hips_below_pelvis: Float[np.ndarray, " 3"]  # from the pelvis body to the middle between the hips

  @property
  def scale(self) -> float:
    """The length of the robot's legs in those of HumanML3D's body."""
    return (self.thigh + self.shin) / float(HUMANML3D.bone_lengths[list(HUMANML3D.leg_bones)].sum())


def sizes_of(robot: Robot) -> Sizes:
  """Distances between the parts of a robot in its upright pose."""
  places, turned = robot.kinematics(robot.standing()[None])
  of = lambda part: robot.place(part, places, turned)[0]
  between = lambda a, b: float(np.mean([np.linalg.norm(of(f"{side}_{a}") - of(f"{side}_{b}")) for side in SIDES]))
  hips = (of("left_hip") + of("right_hip")) / 2
  return Sizes(float(np.linalg.norm(of("left_hip") - of("right_hip"))) / 2, between("hip", "knee"),
               between("knee", "ankle"), between("shoulder", "elbow"), between("elbow", "wrist"), hips - of("pelvis"))


def targets_of(clip: Clip, robot: Robot, fps: float) -> list[Target]:
  """The targets of a clip of HumanML3D's 22 joints at fps frames a second, by the same steps as those of a stream."""
  stream = TargetStream(robot, fps, clip.fps)
  return stream.push(_on_own_body(np.asarray(clip.joints, np.float64))) + stream.finish()


def _on_own_body(joints):
  """Joints with the bone lengths of HumanML3D's body, as all its models give them, the floor at 0."""
  if np.abs(bone_lengths(joints, HUMANML3D).mean(0) - HUMANML3D.bone_lengths).max() > _CANONICAL:
    return retarget(joints)
  floor = floor_height(joints)
  return joints - [0, floor, 0] if abs(floor) > _CANONICAL else joints


class TargetStream:
  """Targets of joints that come block by block; any blocks give the same targets.

  A foot that stands is held in one place, flat on the floor: it goes there while it comes down, and back while it
  lifts.
  """

  def __init__(self, robot: Robot, fps: float, source_fps: float) -> None:
    self.fps, self.source_fps, self.sizes = fps, source_fps, sizes_of(robot)
    soles = [rot.rotate(robot.rest[body][None], points) - self._ankle(robot, side, body)
             for side, (body, points) in zip(SIDES, robot.soles())]
    self._drop = self.sizes.scale * _ANKLE + float(np.mean([sole[:, 2].min() for sole in soles]))
    self._reach, self._blend = int(np.ceil(_WINDOW * fps)), max(int(round(_BLEND * fps)), 1)
    self._source, self._moved, self._stands = _Recent(), _Recent(), _Recent()
    self._feet = [_Foot(self._blend, sole) for sole in soles]
    self._count = 0

  @staticmethod
  def _ankle(robot, side, body):
    """From the body to the ankle, which may be a point in it, with the axes of the world in the upright pose."""
    return rot.rotate(robot.rest[body], robot.parts[f"{side}_ankle"][1])

  def push(self, joints: Num[np.ndarray, "t 22 3"]) -> list[Target]:
    """The targets that joints (T, 22, 3), metres, y up, the floor at 0, have made final."""
    for frame in np.asarray(joints, np.float64):
      self._source.append(frame)
    return self._advance(False)

  def finish(self) -> list[Target]:
    """The targets of the last frames; nothing comes after them."""
    return self._advance(True)

  def _advance(self, last):
    self._resample(last)
    while self._stands.end + (0 if last else self._reach) < self._moved.end:
      self._stands.append(self._stand(self._stands.end))
    first, self._count = self._count, max(self._count, self._stands.end - (0 if last else self._blend))
    targets = self._targets(first, self._count) if self._count > first else []
    self._source.forget(int(self._moved.end * self.source_fps / self.fps) - 2)
    self._moved.forget(self._count - self._reach - 1)
    self._stands.forget(self._count - 1)
    return targets

  def _resample(self, last):
    """Frames at the new rate along cubic curves through each two frames and their neighbours (Catmull-Rom)."""
    count = self._source.end
    ends = int(np.floor((count - 1) * self.fps / self.source_fps + 1e-6))
    while True:
      at = self._moved.end * self.source_fps / self.fps
      first = int(np.floor(at + 1e-9))
      if self._moved.end > ends if last else first + 2 >= count:
        return
      a, b, c, d = (self._source[first + shift] for shift in (-1, 0, 1, 2))
      x = max(at - first, 0.0)
      self._moved.append(b + x / 2 * (c - a + x * (2 * a - 5 * b + 4 * c - d + x * (3 * (b - c) + d - a))))

  def _stand(self, k):
    """Whether the left and the right foot stand, flat, in frame k."""
    around = np.stack([self._moved[i] for i in range(k - self._reach, k + self._reach + 1)])
    stands = feet_stand(around, self.fps, floor=0.0)[self._reach]
    slopes = [abs(_slope(self._moved[k][leg[3]] - self._moved[k][leg[2]]) - _LEVEL) for leg in _LEGS]
    return np.array([stands[0] and stands[1] and slopes[0] < _FLAT, stands[2] and stands[3] and slopes[1] < _FLAT])

  def _targets(self, first, past):
    """The targets of frames first to past - 1. A foot lands where it first stands within _BLEND after a frame."""
    count, sizes = past - first, self.sizes
    seen = np.stack([self._moved[k] for k in range(first, past + self._blend)])
    stands = np.stack([self._stands[k] for k in range(first, past + self._blend)])
    joints, world = seen[:count], to_robot_axes(seen * sizes.scale)
    pelvis, torso = (_quaternion(axes[:, 0]) for axes in body_axes(joints[:, None]))
    turned, limbs = {"pelvis": pelvis, "torso": torso}, {}
    hips = world[:count, [leg[0] for leg in _LEGS]] - [0, 0, self._drop]
    for side, leg, foot, hip, standing in zip(SIDES, _LEGS, self._feet, hips.swapaxes(0, 1), stands.T):
      turns = _foot_turn(seen, leg)
      steps = []
      for k, raw in enumerate(world[:count, leg[2]] - [0, 0, sizes.scale * _ANKLE]):
        coming = np.flatnonzero(standing[k:k + self._blend + 1])
        lands = k + coming[0] if len(coming) else None
        steps.append(foot.step(raw, turns[k], *((None, None) if lands is None else (
            world[lands, leg[2]], _yaw(turns[lands])))))
      ankles, turned[f"{side}_ankle"] = map(np.stack, zip(*steps))
      bent_to = to_robot_axes(knee_side(joints[:, None], leg[:3], HUMANML3D)[:, 0])
      limbs |= {f"{side}_knee": _knee(hip, ankles, bent_to, sizes), f"{side}_ankle": ankles}
    pelvises = hips.mean(1) - rot.rotate(pelvis, sizes.hips_below_pelvis)
    direction = lambda a, b: rot.unit(world[:count, b] - world[:count, a], eps=1e-9)
    arms = {side: (direction(*arm[:2]), direction(*arm[1:])) for side, arm in zip(SIDES, _ARMS)}
    of = lambda parts, k: {name: rows[k] for name, rows in parts.items()}
    return [Target(pelvises[k], of(turned, k), of(limbs, k), {
        side: (upper[k], fore[k]) for side, (upper, fore) in arms.items()}, stands[k]) for k in range(count)]


class _Foot:
  """Path of one foot: free, blended to the place where it stands while it comes down, and back while it lifts."""

  def __init__(self, blend, sole):
    self._blend, self._sole, self._bottom = blend, sole, float(sole[:, 2].min())
    self._weight = self._base = 0.0      # how far it is held, and was when that began to change
    self._passed, self._holds = blend, None  # None: before the first frame
    self._held = self._from = self._to = np.zeros(3)  # x, y, yaw

  def step(self, raw, turn, place, yaw):
    """(ankle (3,), rotation (4,)); raw: the ankle's path with its height over that of a flat foot."""
    if (place is not None) != self._holds:
      first = self._holds is None
      self._holds, self._passed, self._base = place is not None, self._blend if first else 0, self._weight
      if self._holds:
        goal = np.array([*place[:2], yaw])
        start = self._held if self._weight > 0 else goal
        start[2] = goal[2] + (start[2] - goal[2] + np.pi) % (2 * np.pi) - np.pi
        self._from, self._to = start, goal
    x = min(self._passed / self._blend, 1.0)
    smooth = x * x * (3 - 2 * x)
    self._passed += 1
    if self._holds:
      self._weight = self._base + (1 - self._base) * smooth
      self._held = self._from + smooth * (self._to - self._from)
    else:
      self._weight = self._base * (1 - smooth)
    flat = np.array([np.cos(self._held[2] / 2), 0, 0, np.sin(self._held[2] / 2)])
    turn = rot.slerp(turn[None], flat[None], np.array([self._weight]))[0]
    height = (1 - self._weight) * raw[2] - self._bottom
    ankle = np.array([*(raw[:2] + self._weight * (self._held[:2] - raw[:2])), height])
    ankle[2] = max(height, -rot.rotate(turn[None], self._sole)[:, 2].min())
    return ankle, turn


class _Recent:
  """A list whose first items are forgotten; numbers before the first and after the last give those."""

  def __init__(self):
    self._items, self._first = [], 0

  @property
  def end(self):
    return self._first + len(self._items)

  def append(self, item):
    self._items.append(item)

  def __getitem__(self, number):
    return self._items[min(max(number - self._first, 0), len(self._items) - 1)]

  def forget(self, before):
    passed = min(max(before - self._first, 0), len(self._items) - 1)
    if passed > 0:
      del self._items[:passed]
      self._first += passed


def _slope(bone):
  return np.arctan2(-bone[1], np.hypot(bone[0], bone[2]))


def _foot_turn(joints, leg):
  """Rotations (T, 4) in a robot's axes of a foot whose toes are level where it stands flat; its side is the shin's."""
  _, knee, ankle, toes = (joints[:, joint] for joint in leg)
  bone, shin = rot.unit(toes - ankle, eps=1e-9), rot.unit(knee - ankle, eps=1e-9)
  left = rot.unit(np.cross(shin, bone), eps=1e-9)
  down = np.concatenate([np.full((len(left), 1), np.cos(_LEVEL / 2)), -np.sin(_LEVEL / 2) * left], axis=-1)
  ahead = rot.rotate(down, bone)
  return _quaternion(np.stack([left, np.cross(ahead, left), ahead], axis=-1))


def _quaternion(axes):
  return turn_to_robot_axes(rot.from_matrix(axes))


def _yaw(turn):
  ahead = rot.rotate(turn, np.array([1.0, 0, 0]))
  return float(np.arctan2(ahead[1], ahead[0]))


def _knee(hip, ankle, side, sizes):
  """Knees (T, 3) of a leg from hip to ankle, which is drawn nearer where the leg does not reach it."""
  line = ankle - hip
  distance = np.array([np.linalg.norm(row) for row in line])[:, None]
  shorter = np.minimum(1.0, 0.999 * (sizes.thigh + sizes.shin) / np.maximum(distance, 1e-9))
  return bend(hip, hip + shorter * line, side, sizes.thigh, sizes.shin)
