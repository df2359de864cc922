"""Loop a motion, so that its end meets its beginning, or keep it in place: for games and web pages.

The pose of the last frame becomes that of the first by inertialization (D. Bollo, GDC 2018; for loops D. Holden,
theorangeduck.com, 2022): what they differ by, in place and speed, is added to the frames at both ends and fades towards
the middle. The body's speed over the ground and its turning are treated alike, seen from the body, so that a walk
repeated continues straight, or along the same curve. numpy, float64.

What is derived from a loop (rotations, another frame rate, a character's pose) is computed with the neighbouring rounds
around it (`rounds`), so that it is periodic too; `close` then removes the rounding that is left.
"""
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, bone_lengths
from motion_jax.shapes import Array, Float, Num

_FADE = 0.5      # seconds over which a difference fades, at the most half of the motion
_BONES = 5e-3    # metres by which a body's bones may differ from the skeleton's to be held at its lengths
_STANDS = 0.05   # metres a second under which the way of a loop over the ground is drift
_STRAIGHT = np.radians(20)  # of a round, under which its turn is drift
_SAME = 2e-3     # metres between the joints of a loop's first and last frame, seen from the body
_AROUND = 3.0    # seconds of the neighbouring rounds that matter to a loop's frames


def in_place(joints: Num[Array, "t j 3"]) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose root stays over the origin of the ground, x = z = 0."""
  joints = np.asarray(joints, np.float64)
  return (joints - joints[:, :1] * [1, 0, 1]).astype(np.float32)


def velocity(joints: Num[Array, "t j 3"], fps: float, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "3"]:
  """Mean velocity (3,) over the ground in metres a second as the body sees it: x to its left, z ahead, y zero."""
  joints = np.asarray(joints, np.float64)
  if len(joints) < 2:
    return np.zeros(3)
  steps = np.diff(joints[:, 0] * [1, 0, 1], axis=0)
  return _turned(steps[:, None], -_heading(joints, skeleton)[:-1])[:, 0].mean(0) * fps * skeleton.unit


def looped(joints: Num[Array, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D, keep_way: bool = False
           ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose last frame has the pose of the first, reached and left at the same speed.

  Played again and again, the last frame is the first of the next round, moved and turned over the ground. A body that
  hardly travels ends where it began, one that hardly turns ends as it faced. keep_way: the root stays on its way over
  the ground, and faces as it does, to the centimetre; only poses are changed. Raises ValueError for under 4 frames.
  """
  joints = np.asarray(joints, np.float64)
  count = len(joints)
  if count < 4:
    raise ValueError(f"got {count} frames to be looped, expected 4 or more")
  fits = np.abs(bone_lengths(joints, skeleton) - skeleton.bone_lengths).max() * skeleton.unit < _BONES
  heading, ground = _heading(joints, skeleton), joints[:, 0] * [1, 0, 1]
  body = _turned(joints - ground[:, None], -heading)
  # Steps over the ground as the body sees them, and how far it turns in each.
  steps = _turned(np.diff(ground, axis=0)[:, None], -heading[:-1])[:, 0]
  turns = np.diff(heading)
  fade = min(_FADE * fps, (count - 1) / 2)
  body = body + _bridge(body[-1] - body[0], (body[-1] - body[-2]) - (body[1] - body[0]), count, fade)
  if not keep_way:
    steps = steps + _bridge(steps[-1] - steps[0], np.zeros(3), count - 1, fade)
    turns = turns + _bridge(turns[-1] - turns[0], 0.0, count - 1, fade)
    drift = (turns.sum() + np.pi) % (2 * np.pi) - np.pi  # whole turns end as they began
    turns -= drift / (count - 1) if abs(drift) < _STRAIGHT else 0.0
  heading = heading[0] + np.append(0.0, np.cumsum(turns))
  steps = _turned(steps[:, None], heading[:-1])[:, 0]
  if not keep_way and np.linalg.norm(drift := steps.mean(0)) * fps * skeleton.unit < _STANDS:
    steps = steps - drift
  ground = ground[0] + np.append(np.zeros((1, 3)), np.cumsum(steps, axis=0), 0)
  result = _turned(body, heading) + ground[:, None]
  return (with_lengths(result, skeleton) if fits else result).astype(np.float32)


def is_loop(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> bool:
  """Whether a motion of 4 frames or more ends in the pose in which it begins, wherever it stands and faces then."""
  if len(joints) < 4:
    return False
  ends = np.asarray(joints, np.float64)[[0, -1]]
  body = _turned(ends - ends[:, :1] * [1, 0, 1], -_heading(ends, skeleton))
  return bool(np.linalg.norm(body[1] - body[0], axis=-1).max() * skeleton.unit < _SAME)


def turn_of_round(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> float:
  """The angle about y, from z to x, by which a loop faces another way after each round."""
  heading = _heading(np.asarray(joints, np.float64), skeleton)
  return float(heading[-1] - heading[0])


def around(count: int, fps: float) -> int:
  """How many frames of the neighbouring rounds to use with a loop of count frames."""
  return min(count - 2, round(_AROUND * fps))


def rounds(points: Num[Array, "t j 3"], pad: int, turn: float) -> Float[np.ndarray, "n j 3"]:
  """Points (pad + T + pad, J, 3) of a loop (T, J, 3), the first point its root: frames of the round before and of the
  round after are added, moved and turned as the rounds are (`turn_of_round`). pad: under T - 1."""
  points = np.asarray(points, np.float64)
  first, last = points[0, 0] * [1, 0, 1], points[-1, 0] * [1, 0, 1]
  placed = lambda part, angle, start, end: _turned(part - start, np.full(len(part), angle)) + end
  return np.concatenate([placed(points[-1 - pad:-1], -turn, last, first), points,
                         placed(points[1:pad + 1], turn, first, last)])


def close(places: Float[np.ndarray, "t n 3"], turned: Float[np.ndarray, "t m 4"], turn: float
          ) -> tuple[Float[np.ndarray, "t n 3"], Float[np.ndarray, "t m 4"]]:
  """World places (T, N, 3), the first of them the root's, and rotations (T, M, 4) whose last frame is the first one
  moved and turned over the ground."""
  places, turned = places.copy(), turned.copy()
  end = places[-1, 0] * [1, 0, 1]
  places[-1] = _turned(places[:1] - places[0, 0] * [1, 0, 1], np.array([turn]))[0] + end
  turned[-1] = rot.multiply(rot.about_axis(np.array(turn), "y"), turned[0])
  return places, turned


def _bridge(away: np.ndarray | float, drift: np.ndarray | float, count: int, fade: float) -> np.ndarray:
  """What to add (count, ...) so that the last value less the first, away, and their speeds, drift a frame, become
  none; each end takes a half."""
  away, drift = np.asarray(away, np.float64), np.asarray(drift, np.float64)
  k = np.arange(count).reshape((-1,) + (1,) * away.ndim)

  def fading(offset: Any, speed: Any, frames: np.ndarray) -> np.ndarray:
    s = np.minimum(frames / fade, 1)  # cubic: none of it, and no speed, is left at its end
    return offset * (2 * s ** 3 - 3 * s ** 2 + 1) + speed * fade * (s ** 3 - 2 * s ** 2 + s)

  # The second half runs backwards from the last frame, so its speed has the other sign twice.
  return fading(away / 2, drift / 2, k) + fading(-away / 2, drift / 2, count - 1 - k)


def _heading(joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
  """Angles (T,) about y, from z to x, of where the body faces; they do not jump by whole turns."""
  right, left = skeleton.hips
  across = joints[:, left] - joints[:, right]
  return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))


def _turned(points: np.ndarray, angle: np.ndarray) -> np.ndarray:
  """Points (T, n, 3) turned about y by angles (T,), from z to x."""
  c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
  x, y, z = np.moveaxis(points, -1, 0)
  return np.stack([c * x + s * z, y, c * z - s * x], -1)
