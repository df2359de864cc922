"""Loop a motion, so that its end meets its beginning, or keep it in place: for games and web pages.

The pose of the last frame becomes that of the first by inertialization (D. Bollo, GDC 2018; for loops D. Holden,
theorangeduck.com, 2022): their difference of position and speed is distributed to both ends and fades towards the
middle. The body's speed over the ground and its turning, relative to the body, are treated alike: a repeated walk
continues straight, or along the same curve. numpy, float64.

Whatever is derived from a loop (rotations, another frame rate, a character's pose) is computed with the neighbouring
repetitions around it (`rounds`) and hence periodic too; `close` then removes the remaining rounding errors.
"""
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, bone_lengths
from motion_jax.shapes import Array, Float, Num

_FADE = 0.5      # seconds over which a difference fades, at the most half of the motion
_BONES = 5e-3    # metres: bones that differ less from the skeleton's are kept at its lengths
_STANDS = 0.05   # metres a second: a slower path of a loop over the ground is drift, which is removed
_STRAIGHT = np.radians(20)  # a smaller turn per repetition is drift, which is removed
_SAME = 2e-3     # metres: tolerance between the joints of a loop's first and last frame, relative to the body
_AROUND = 3.0    # seconds of the neighbouring repetitions that derived values depend on


def in_place(joints: Num[Array, "t j 3"]) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) with the root fixed over the origin of the ground, x = z = 0."""
  joints = np.asarray(joints, np.float64)
  return (joints - joints[:, :1] * [1, 0, 1]).astype(np.float32)


def velocity(joints: Num[Array, "t j 3"], fps: float, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "3"]:
  """Mean velocity (3,) over the ground, metres a second, in the body's frame: x to its left, z ahead, y zero."""
  joints = np.asarray(joints, np.float64)
  if len(joints) < 2:
    return np.zeros(3)
  steps = np.diff(joints[:, 0] * [1, 0, 1], axis=0)
  return rot.rotate_about_y(steps, -_heading(joints, skeleton)[:-1]).mean(0) * fps * skeleton.unit


def looped(joints: Num[Array, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D, keep_way: bool = False
           ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose last frame has the pose and the speed of the first.

  In repetition the last frame is the first of the next round, moved and turned over the ground. A body that hardly
  travels ends where it began, one that hardly turns ends with its first heading. keep_way: root path and heading stay
  to the centimetre; only poses change. Raises ValueError for fewer than 4 frames.
  """
  joints = np.asarray(joints, np.float64)
  count = len(joints)
  if count < 4:
    raise ValueError(f"got {count} frames to be looped, expected 4 or more")
  fits = np.abs(bone_lengths(joints, skeleton) - skeleton.bone_lengths).max() * skeleton.unit < _BONES
  heading, ground = _heading(joints, skeleton), joints[:, 0] * [1, 0, 1]
  body = rot.rotate_about_y(joints - ground[:, None], -heading[:, None])
  # Steps over the ground in the body's frame, and changes of heading.
  steps = rot.rotate_about_y(np.diff(ground, axis=0), -heading[:-1])
  turns = np.diff(heading)
  fade = min(_FADE * fps, (count - 1) / 2)
  body = body + _bridge(body[-1] - body[0], (body[-1] - body[-2]) - (body[1] - body[0]), count, fade)
  if not keep_way:
    steps = steps + _bridge(steps[-1] - steps[0], np.zeros(3), count - 1, fade)
    turns = turns + _bridge(turns[-1] - turns[0], 0.0, count - 1, fade)
    drift = (turns.sum() + np.pi) % (2 * np.pi) - np.pi  # whole turns end as they began
    turns -= drift / (count - 1) if abs(drift) < _STRAIGHT else 0.0
  heading = heading[0] + np.append(0.0, np.cumsum(turns))
  steps = rot.rotate_about_y(steps, heading[:-1])
  if not keep_way and np.linalg.norm(drift := steps.mean(0)) * fps * skeleton.unit < _STANDS:
    steps = steps - drift
  ground = ground[0] + np.append(np.zeros((1, 3)), np.cumsum(steps, axis=0), 0)
  result = rot.rotate_about_y(body, heading[:, None]) + ground[:, None]
  return (with_lengths(result, skeleton) if fits else result).astype(np.float32)


def is_loop(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> bool:
  """Whether a motion of 4 frames or more ends in its first pose, at any position and heading."""
  if len(joints) < 4:
    return False
  ends = np.asarray(joints, np.float64)[[0, -1]]
  body = rot.rotate_about_y(ends - ends[:, :1] * [1, 0, 1], -_heading(ends, skeleton)[:, None])
  return bool(np.linalg.norm(body[1] - body[0], axis=-1).max() * skeleton.unit < _SAME)


def turn_of_round(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> float:
  """Change of heading in each round of a loop: the angle about y, from z to x."""
  heading = _heading(np.asarray(joints, np.float64), skeleton)
  return float(heading[-1] - heading[0])


def around(count: int, fps: float) -> int:
  """Number of frames of the neighbouring rounds to use with a loop of count frames."""
  return min(count - 2, round(_AROUND * fps))


def rounds(points: Num[Array, "t j 3"], pad: int, turn: float) -> Float[np.ndarray, "n j 3"]:
  """A loop (T, J, 3), its first point the root, with pad frames of the round before and of the round after, moved and
  turned over the ground: (pad + T + pad, J, 3). turn: `turn_of_round`; pad: under T - 1."""
  points = np.asarray(points, np.float64)
  first, last = points[0, 0] * [1, 0, 1], points[-1, 0] * [1, 0, 1]
  placed = lambda part, angle, start, end: rot.rotate_about_y(part - start, angle) + end
  return np.concatenate([placed(points[-1 - pad:-1], -turn, last, first), points,
                         placed(points[1:pad + 1], turn, first, last)])


def close(places: Float[np.ndarray, "t n 3"], turned: Float[np.ndarray, "t m 4"], turn: float
          ) -> tuple[Float[np.ndarray, "t n 3"], Float[np.ndarray, "t m 4"]]:
  """Make a loop exact: world positions (T, N, 3), the root's first, and rotations (T, M, 4) whose last frame is the
  first one, moved and turned over the ground."""
  places, turned = places.copy(), turned.copy()
  end = places[-1, 0] * [1, 0, 1]
  places[-1] = rot.rotate_about_y(places[0] - places[0, 0] * [1, 0, 1], turn) + end
  turned[-1] = rot.multiply(rot.about_axis(np.array(turn), "y"), turned[0])
  return places, turned


def _bridge(away: np.ndarray | float, drift: np.ndarray | float, count: int, fade: float) -> np.ndarray:
  """Offsets (count, ...) that cancel the difference of the last value and the first, away, and of their speeds, drift
  per frame; half at each end."""
  away, drift = np.asarray(away, np.float64), np.asarray(drift, np.float64)
  k = np.arange(count).reshape((-1,) + (1,) * away.ndim)

  def fading(offset: Any, speed: Any, frames: np.ndarray) -> np.ndarray:
    s = np.minimum(frames / fade, 1)  # cubic, with value and speed 0 at its end
    return offset * (2 * s ** 3 - 3 * s ** 2 + 1) + speed * fade * (s ** 3 - 2 * s ** 2 + s)

  # The second half runs backwards from the last frame, so its speed has the other sign twice.
  return fading(away / 2, drift / 2, k) + fading(-away / 2, drift / 2, count - 1 - k)


def _heading(joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
  """Headings (T,): angles about y, from z to x, without jumps by whole turns."""
  right, left = skeleton.hips
  across = joints[:, left] - joints[:, right]
  return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))

