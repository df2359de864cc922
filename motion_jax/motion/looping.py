"""Loop a motion, so that its end meets its beginning, or keep it in place: for games and web pages.

The pose of the last frame becomes that of the first by inertialization (D. Bollo, GDC 2018; for loops D. Holden,
theorangeduck.com, 2022): what they differ by, in place and speed, is added to the frames at both ends and fades towards
the middle. The body's speed over the ground and its turning are treated alike, seen from the body, so that a walk
repeated continues straight, or along the same curve. numpy, float64.
"""
from typing import Any

import numpy as np
from jaxtyping import Float, Num

from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, bone_lengths
from motion_jax.shapes import Array

_FADE = 0.5      # seconds over which a difference fades, at the most half of the motion
_BONES = 5e-3    # metres by which a body's bones may differ from the skeleton's to be held at its lengths


def in_place(joints: Num[Array, "t j 3"]) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose root stays over one spot of the ground, that of the first frame."""
  joints = np.asarray(joints, np.float64)
  return (joints - (joints[:, :1] - joints[:1, :1]) * [1, 0, 1]).astype(np.float32)


def looped(joints: Num[Array, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D, keep_way: bool = False
           ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose last frame has the pose of the first, reached and left at the same speed.

  Played again and again, the last frame is the first of the next round, moved and turned over the ground. keep_way: the
  root stays on its way over the ground, and faces as it does, to the centimetre; only poses are changed. Raises
  ValueError for fewer than 4 frames.
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
  heading = heading[0] + np.append(0.0, np.cumsum(turns))
  ground = ground[0] + np.append(np.zeros((1, 3)), np.cumsum(_turned(steps[:, None], heading[:-1])[:, 0], axis=0), 0)
  result = _turned(body, heading) + ground[:, None]
  return (with_lengths(result, skeleton) if fits else result).astype(np.float32)


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
