"""Procedural motion of people walking, turning, waving and jumping: tests and tiny configs need no download.

Every clip starts at the origin facing +z, on the canonical skeleton with exact bone lengths, y = 0 under the toes.
"""
import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import bend
from motion_jax.motion.skeleton import HUMANML3D

FPS = 20.0
LICENSE = "Apache-2.0, procedural motion"
_ANKLE, _STAND = 0.06, 0.945  # heights of ankles and pelvis of a standing body, metres
# Directions of trunk and shoulder bones in the pelvis frame (x left, y up, z ahead), about those of an adult at ease.
_TRUNK = {"left_hip": (0.57, -0.8, 0), "right_hip": (-0.57, -0.8, 0), "spine1": (0, 1, -0.1), "spine2": (0, 1, 0.05),
          "spine3": (0, 1, 0.1), "neck": (0, 1, -0.1), "left_collar": (0.65, 0.75, 0), "right_collar": (-0.65, 0.75, 0),
          "head": (0, 0.9, 0.4), "left_shoulder": (0.95, 0.25, 0), "right_shoulder": (-0.95, 0.25, 0)}

_CAPTIONS = {
    "stand": ("a person stands still.", "someone is standing in place."),
    "walk": ("a person walks forward.", "a man walks straight ahead.", "someone is walking forward."),
    "run": ("a person runs forward.", "someone is running ahead quickly."),
    "curve_left": ("a person walks in a curve to the left.", "someone walks and bends to the left."),
    "curve_right": ("a person walks in a curve to the right.", "someone walks and bends to the right."),
    "turn_left": ("a person turns left.", "someone turns around counterclockwise on the spot."),
    "turn_right": ("a person turns right.", "someone turns around clockwise on the spot."),
    "wave_left": ("a person waves with the left hand.", "someone raises the left arm and waves."),
    "wave_right": ("a person waves with the right hand.", "someone raises the right arm and waves."),
    "jump": ("a person jumps up.", "someone hops on the spot."),
    "squat": ("a person squats down and stands up.", "someone bends the knees and gets up again."),
}
ACTIONS = tuple(_CAPTIONS)


def synthetic_clips(seed=0, num=22, num_frames=None, skeleton=HUMANML3D) -> list[Clip]:
  """num clips, the actions in turn, each with its own speed and length; the same seed gives the same clips.

  num_frames fixes the length, else 60 to 120 frames. Of every five clips the fourth is for validation, the fifth for
  test. On another skeleton the same motions come at its rate, with as many more or fewer frames.
  """
  clips = []
  for index in range(num):
    rng = np.random.default_rng((seed, index))
    action = ACTIONS[index % len(ACTIONS)]
    frames = num_frames or int(rng.integers(60, 121))
    clips.append(Clip(
        joints=synthetic_joints(action, frames, rng).astype(np.float32), fps=FPS,
        captions=tuple(Caption(text) for text in _CAPTIONS[action]), id=f"{index:06d}",
        split=("train", "train", "train", "val", "test")[index % 5], source="synthetic", license=LICENSE,
        meta={"action": action, "optimality": 1.0}))  # each does what its caption says
  return clips if skeleton is HUMANML3D else [clip.on_skeleton(skeleton) for clip in clips]


def synthetic_joints(action, num_frames, rng) -> np.ndarray:
  """Joints (T, 22, 3), float64, metres, 20 frames a second, of one of ACTIONS."""
  if action not in _CAPTIONS:
    raise ValueError(f"got action {action!r}, expected one of {', '.join(ACTIONS)}")
  time = np.arange(num_frames) / FPS
  seconds = num_frames / FPS
  done = np.clip(time / time[-1], 0, 1) if num_frames > 1 else np.zeros(1)
  breath = np.sin(2 * np.pi * 0.3 * time)
  sign = -1.0 if action.endswith("right") else 1.0
  travel, turn, stride, lift, drop = 0.0, 0.0, 1.2, 0.0, 0.0 * time
  if action in ("walk", "run", "curve_left", "curve_right"):
    speed = rng.uniform(2.2, 3.0) if action == "run" else rng.uniform(0.9, 1.4)
    stride, lift = (2.0, 0.22) if action == "run" else (1.2, 0.12)
    travel = stride * max(1, round(speed * seconds / stride))
    turn = sign * rng.uniform(1.0, 2.0) if "curve" in action else 0.0
    drop = 0.06 + 0.02 * np.cos(4 * np.pi * travel * _ease(done) / stride)
  elif action.startswith("turn"):
    turn, lift, drop = sign * rng.uniform(0.5, 1.0) * np.pi, 0.06, 0.03 + 0 * time
    stride = abs(turn) / max(1, round(abs(turn) / 1.2))  # radians that two steps turn
  elif action == "squat":
    drop = rng.uniform(0.25, 0.4) * np.sin(np.pi * done) ** 2
  air = np.zeros(num_frames)
  if action == "jump":
    crouch, flight, begin = rng.uniform(0.12, 0.2), rng.uniform(0.2, 0.4), rng.uniform(0.1, 0.5)
    beat = (time - begin * max(seconds - 1.8, 0)) / min(0.6, seconds / 3)  # crouch, fly, land
    air = flight * np.clip(1 - (2 * (beat - 1.5)) ** 2, 0, None)
    drop = crouch * (np.sin(np.pi * np.clip(beat, 0, 1)) ** 2 + np.sin(np.pi * np.clip(beat - 2, 0, 1)) ** 2)

  # The body follows a path by its parameter u: metres, or radians when it turns on the spot.
  total = travel or abs(turn)
  place = _path(travel, turn, total)
  u = total * _ease(done)
  pace = np.gradient(_ease(done), done) if num_frames > 1 else np.zeros(1)
  position, heading = place(u)
  joints = np.zeros((num_frames, HUMANML3D.num_joints, 3))
  joints[:, 0] = position + np.stack([0 * u, _STAND - drop - 0.02 * (lift > 0) + air, 0 * u], -1)
  lean = 0.25 if action == "run" else 0.05 if travel else 0.0
  turned = rot.about_axis(heading, "y")
  trunk = rot.multiply(turned, rot.about_axis(lean + drop * 0.8 + 0.01 * breath, "x"))
  step = 2 * np.pi * u / stride
  for name in _TRUNK:
    _grow(joints, name, turned if "hip" in name else trunk, np.array(_TRUNK[name], np.float64))
  for side, out in (("left", 1.0), ("right", -1.0)):
    swing = (0.0 if not total else 0.6 * np.clip(pace, 0, 1)) * np.cos(step) * -out
    bent = np.full(num_frames, 1.2 if action == "run" else 0.25)
    upper = np.stack([0.2 * out + 0 * u, -np.cos(swing), np.sin(swing)], -1)
    lower = np.stack([0.1 * out + 0 * u, -np.cos(swing + bent), np.sin(swing + bent)], -1)
    if action == f"wave_{side}":
      up = _ease(np.clip(6 * done, 0, 1)) * _ease(np.clip(6 * (1 - done), 0, 1))
      sway = 0.6 * np.sin(2 * np.pi * 1.5 * time)
      upper = _toward(upper, np.stack([0.9 * out + 0 * u, 0.35 + 0 * u, 0.25 + 0 * u], -1), up)
      lower = _toward(lower, np.stack([np.sin(sway), np.cos(sway), 0.2 + 0 * u], -1), up)
    _grow(joints, f"{side}_elbow", trunk, upper)
    _grow(joints, f"{side}_wrist", trunk, lower)
    _step_leg(joints, side, out, u, stride, lift * np.clip(pace, 0, 1), air, place, run=action == "run")
  return joints


def _path(travel, turn, total):
  """Where a body is that has gone u of its way: u (T,) -> positions (T, 3) on the ground, headings (T,)."""
  grid = np.linspace(-0.25 * total - 1e-3, 1.25 * total + 1e-3, 2001)
  angle = turn * (np.clip(grid / total, 0, 1) if total else 0 * grid)
  step = np.stack([np.sin(angle), 0 * grid, np.cos(angle)], -1) * (grid[1] - grid[0]) * bool(travel)
  track = np.cumsum(step, axis=0)
  at = lambda u, values: np.interp(u, grid, values)
  start = [at(0.0, track[:, axis]) for axis in range(3)]

  def place(u):
    return np.stack([at(u, track[:, axis]) - start[axis] for axis in range(3)], -1), at(u, angle)
  return place


def _step_leg(joints, side, out, u, stride, lift, air, place, run):
  """Adds knee, ankle and toes: the foot stands on the path while the body passes over it, then swings ahead."""
  stands = 0.4 if run else 0.6  # of a cycle
  half = 0.0 if side == "left" else 0.5
  cycle = u / stride + stands / 2 + half
  swing = np.clip((cycle % 1 - stands) / (1 - stands), 0, 1)
  spot, heading = place(stride * (np.floor(cycle) - half + _ease(swing)))
  turned = rot.about_axis(heading, "y")
  rise = lift * np.sin(np.pi * swing) + air
  ankle = spot + rot.rotate(turned, np.array([0.09 * out, 0, -0.03]))
  ankle[:, 1] += _ANKLE + rise
  number = {name: HUMANML3D.joints.index(f"{side}_{name}") for name in ("hip", "knee", "ankle", "foot")}
  hip = joints[:, number["hip"]]
  thigh, shin = HUMANML3D.bone_lengths[[number["knee"], number["ankle"]]]
  line = ankle - hip
  distance = np.linalg.norm(line, axis=-1, keepdims=True)
  ankle = hip + line * np.minimum(1, 0.995 * (thigh + shin) / distance)
  joints[:, number["ankle"]] = ankle
  joints[:, number["knee"]] = bend(hip, ankle, rot.rotate(turned, np.array([0.0, 0.0, 1.0])), thigh, shin)
  length = HUMANML3D.bone_lengths[number["foot"]]
  down = np.clip(np.arcsin(_ANKLE / length) + 2.0 * np.clip(rise, 0, 0.3) * (1 if np.any(air) else 0.5), 0, 1.2)
  toes = np.stack([0 * u, -np.sin(down), np.cos(down)], -1)
  joints[:, number["foot"]] = ankle + length * rot.rotate(turned, toes)


def _grow(joints, name, turned, direction):
  """Adds the joint at the end of a bone that points in a direction of the turned body."""
  joint = HUMANML3D.joints.index(name)
  bone = rot.rotate(turned, rot.unit(np.broadcast_to(direction, (len(joints), 3)))) * HUMANML3D.bone_lengths[joint]
  joints[:, joint] = joints[:, HUMANML3D.parents[joint]] + bone


def _toward(a, b, weight):
  return rot.unit(rot.unit(a) * (1 - weight[:, None]) + rot.unit(b) * weight[:, None])


def _ease(x):
  """From 0 to 1 with no speed at either end."""
  return x * x * (3 - 2 * x)


class Synthetic(Dataset):
  """Procedural motion: config.seed, config.num_clips."""
  name, holds = "synthetic", "procedural motion"
  by_clip = in_folders = False
  fields = ("mode", "mirror", "kinematic_captions", "augment", "paraphrases", "seed", "num_clips")

  def matches(self, folder):
    return False

  def clips(self, folder=None, split=None, faults=None):
    return [clip for clip in synthetic_clips() if split in (None, clip.split)]

  def pieces(self, folder, config):
    return synthetic_clips(config.get("seed", 0), config.get("num_clips", 16))
