"""Bend a straight walk or run onto another path: circles, arcs, u-turns, zigzags; feet stay pinned.

The course c(l) is the path of the pelvis without the sway of the steps. Each piece of it is turned by angle(l), and
each frame is turned with its piece. A standing foot takes the turn at the middle of its stance; in the air the turn is
interpolated to the next stance by 3 u^2 - 2 u^3; the legs follow. A body leans into a curve of radius r by
atan(v^2 / g r). Separating path and detail: M. Gleicher, Motion path editing, I3D 2001. numpy, whole clips, float64.
"""
from collections.abc import Callable

import numpy as np

from motion_jax.motion.contacts import velocity
from motion_jax.motion.pinned_feet import pin_feet
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.smoothing import gaussian_along_path, gaussian_filter1d
from motion_jax.shapes import Array, Float, Num

SMALLEST = {"walk": 1.2, "run": 3.0}  # metres: the smallest radius at which standing feet need not twist
_STEP = 0.35       # seconds, sigma of the Gaussian that removes the sway of the steps
_G = 9.81
_STANDS = (0.35, 0.14)  # upper limits of a standing foot: speed relative to the body's, metres above the floor
_LEAN = 0.7        # share of the lean that balances a point mass: feet are placed a little outside, too


def course(joints: Num[Array, "t j 3"], fps: float = 20.0) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, " t"]]:
  """The course of a body: x and z (T, 2) of its pelvis without the sway of the steps, and its arc length (T,)."""
  root = np.asarray(joints, np.float64)[:, 0][:, [0, 2]]
  smooth = gaussian_along_path(root, _STEP * fps, int(4 * _STEP * fps), int(fps))
  return smooth, np.append(0.0, np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=-1)))


def bent(joints: Num[Array, "t j 3"], angle: Callable[[np.ndarray], np.ndarray], skeleton: Skeleton = HUMANML3D,
         fps: float = 20.0) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) whose course is turned to the left by angle(l), radians, at arc length l (N,) from its beginning.

  joints: have the skeleton's bone lengths. Feet are placed as if each step were turned as a whole.
  """
  joints = np.asarray(joints, np.float64)
  path, gone = course(joints, fps)
  turn = angle(gone)
  steps = np.diff(path, axis=0)
  middle = angle((gone[1:] + gone[:-1]) / 2)
  goal = path[0] + np.append(np.zeros((1, 2)), np.cumsum(turned(steps, middle), axis=0), axis=0)
  return along(joints, turn, path, goal, skeleton, fps)


def along(joints: Num[Array, "t j 3"], turn: Float[np.ndarray, " t"], path: Float[np.ndarray, "t 2"],
          goal: Float[np.ndarray, "t 2"], skeleton: Skeleton = HUMANML3D, fps: float = 20.0
          ) -> Float[np.ndarray, "t j 3"]:
  """Moves joints (T, J, 3) from one course to another: each frame turns to the left by turn (T,), radians, about
  path (T, 2), x and z, and moves from there to goal (T, 2). Each step turns and moves as a whole: feet do not slide."""
  joints = np.asarray(joints, np.float64)
  gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=-1)))
  body = _moved(joints, turn, path, goal)
  _lean(body, turn, gone, goal, floor_height(joints, skeleton), fps)
  aims = np.empty((2, len(joints), 2, 3))
  for side, points in enumerate((skeleton.left_feet, skeleton.right_feet)):
    when = _when(_stances(joints, points, gone, skeleton, fps))
    placed = _moved(joints[:, list(points)], *(_at(values, when) for values in (turn, path, goal)))
    aims[:, :, side] = placed.swapaxes(0, 1)
  return pin_feet(body, aims[0], aims[1], skeleton)


def _at(values, when):
  """Values (T, ...) at fractional frame numbers (N,), by linear interpolation."""
  low = np.clip(when.astype(int), 0, max(len(values) - 2, 0))
  part = (when - low).reshape((-1,) + (1,) * (values.ndim - 1))
  return values[low] * (1 - part) + values[np.minimum(low + 1, len(values) - 1)] * part


def turned(vectors: Num[Array, "n 2"], angle: np.ndarray | float) -> Float[np.ndarray, "n 2"]:
  """Ground vectors (N, 2), x and z, turned to the left by one angle or by (N,) angles, radians."""
  sin, cos = np.sin(angle), np.cos(angle)
  return np.stack([vectors[:, 0] * cos + vectors[:, 1] * sin, vectors[:, 1] * cos - vectors[:, 0] * sin], -1)


def _moved(joints, turn, path, goal):
  """Joints (T, J, 3), each frame turned about path (T, 2) and moved from there to goal (T, 2)."""
  result = joints.copy()
  off = joints[..., [0, 2]] - path[:, None]
  for joint in range(joints.shape[1]):
    result[:, joint, [0, 2]] = turned(off[:, joint], turn) + goal
  return result


def _lean(body, turn, gone, goal, floor, fps):
  """Leans bodies (T, J, 3) into the curves of their path, about their ground positions. In place."""
  speed = np.gradient(gone) * fps
  push = gaussian_filter1d(speed * np.gradient(turn) * fps, _STEP * fps, mode="nearest")  # v^2 / r, to the left
  lean = np.arctan(_LEAN * push / _G)
  ahead = np.gradient(goal, axis=0)
  ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
  left = np.stack([ahead[:, 1], -ahead[:, 0]], -1)
  off = body[..., [0, 2]] - goal[:, None]
  aside, height = (off * left[:, None]).sum(-1), body[..., 1] - floor
  sin, cos = np.sin(lean)[:, None], np.cos(lean)[:, None]
  body[..., [0, 2]] += ((aside * cos + height * sin - aside)[..., None]) * left[:, None]
  body[..., 1] = floor + height * cos - aside * sin


def _stances(joints, points, gone, skeleton, fps):
  """Mask (T,) of the stances of a foot: one of its points is slow compared with the body and near the ground."""
  feet = joints[:, list(points)]
  slow = np.linalg.norm(velocity(feet, fps)[..., [0, 2]], axis=-1) * skeleton.unit
  body = np.gradient(gone) * fps * skeleton.unit
  low = (feet[..., 1] - floor_height(joints, skeleton)) * skeleton.unit < _STANDS[1]
  return (low & (slow < np.maximum(_STANDS[0] * body, 0.15)[:, None])).any(1)


def _when(stance):
  """The frame (T,) whose turn a foot takes: the middle of its stance, eased from one stance to the next."""
  edges = np.flatnonzero(np.diff(np.concatenate([[False], stance, [False]]).astype(int)))
  spans = list(zip(edges[::2], edges[1::2] - 1))
  ends, middles = [], []
  for first, last in spans:
    # Of a stance that is cut off by the clip, the middle of the visible part counts.
    ends += [first, last]
    middles += [(first + last) / 2] * 2
  if not spans or spans[0][0] > 0:
    ends, middles = [0, *ends], [0.0, *middles]
  if not spans or spans[-1][1] < len(stance) - 1:
    ends, middles = [*ends, len(stance) - 1], [*middles, len(stance) - 1.0]
  frames = np.arange(len(stance))
  times, values = np.array(ends, float), np.array(middles, float)
  place = np.clip(np.searchsorted(times, frames, side="right") - 1, 0, max(len(times) - 2, 0))
  span = np.maximum(times[place + 1] - times[place], 1)
  u = np.clip((frames - times[place]) / span, 0, 1)
  return values[place] + (values[place + 1] - values[place]) * u * u * (3 - 2 * u)
