"""Foot contacts: a foot stands if it is slow and near the ground. All code that needs contacts uses this rule.

HumanML3D's contact label, a column of benchmark features, is looser: a squared step below 0.002 is 0.89 m/s at 20
frames a second, so that a foot that slides counts as standing. numpy, whole clips; with a floor given also jax arrays,
inside jit as well.
"""
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Bool, Float, Num

SLOW = 0.15   # metres a second
LOW = 0.10    # metres over the floor
_SPAN = 0.1   # seconds over which a speed is taken, whatever the rate
_SHORT = 0.25  # seconds of the median filter, which removes contacts and gaps shorter than half of it


def feet_stand(joints: Num[A, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D,
               floor: float | None = None) -> Bool[A, "t 4"]:
  """Whether left ankle, left toes, right ankle, right toes stand in each frame of joints (T, J, 3): (T, 4).

  A joint stands if it moves slower than 0.15 m/s and is less than 0.10 m above the floor, for most of the 0.25 s around
  the frame; the rule does not depend on the frame rate from 20 frames a second on. floor: its height in the skeleton's
  unit; None uses `floor_height` of this motion.
  """
  xp: Any = rot.namespace(joints)
  feet = xp.asarray(joints, _exact(xp))[:, np.array(skeleton.left_feet + skeleton.right_feet)] * skeleton.unit
  ground = (floor_height(np.asarray(joints), skeleton) if floor is None else floor) * skeleton.unit
  stands = (xp.linalg.norm(velocity(feet, fps), axis=-1) < SLOW) & (feet[..., 1] - ground < LOW)
  return majority(stands, fps)


def velocity(points: Num[A, " t *n"], fps: float, span: float = _SPAN) -> Float[A, " t *n"]:
  """Velocity of points (T, ...), units a second, as differences over `span` seconds around each frame."""
  xp: Any = rot.namespace(points)
  points = xp.asarray(points, _exact(xp))
  time = np.arange(len(points)) / fps
  first, past = (np.clip(time + shift, 0, time[-1]) for shift in (-span / 2, span / 2))
  passed = np.maximum(past - first, 1e-9).reshape((-1,) + (1,) * (points.ndim - 1))
  return (_at(points, past * fps) - _at(points, first * fps)) / passed


def majority(flags: Bool[A, " t *n"], fps: float, seconds: float = _SHORT) -> Bool[A, " t *n"]:
  """Median filter: each flag (T, ...) becomes that of most frames within `seconds` around it."""
  half = int(seconds * fps / 2 + 0.5)
  padded = rot.namespace(flags).pad(flags, ((half, half),) + ((0, 0),) * (flags.ndim - 1), mode="edge")
  return sum(padded[i:i + len(flags)].astype(int) for i in range(2 * half + 1)) > half


def _exact(xp):
  """dtype of computations: float64 for numpy, for jax that of the input."""
  return np.float64 if xp is np else None


def _at(points, frames):
  """Points (T, ...) at fractional frame numbers, by linear interpolation."""
  low = np.minimum(np.floor(frames + 1e-9).astype(int), len(points) - 1)
  part = np.clip(frames - low, 0, 1).reshape((-1,) + (1,) * (points.ndim - 1))
  return points[low] * (1 - part) + points[np.minimum(low + 1, len(points) - 1)] * part
