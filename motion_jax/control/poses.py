"""Whole-body pose constraints: blend a motion into poses, and adopt the bone lengths of their body.

For each joint, with positions x(t) of the motion and y(t) of the result, y = x + e,

  min  sum_t |e_(t+1) - 2 e_t + e_(t-1)|^2  +  w_t |y_(t+1) - 2 y_t + y_(t-1)|^2  +  pull |e|^2,   y = pose where given;

w is large between poses that are close in time, where interpolation is better than the generated motion, and between
poses that require very different changes. Bone lengths are restored afterwards. Smoothness terms are banded symmetric
matrices (3, T): the diagonal and the two below it. numpy, float64.
"""
import dataclasses

import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.motion.retarget import retarget, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.shapes import Bool, Float

FADES = 0.3              # seconds: time scale of the change around one pose
_THICK, _OWN = 0.25, 3.0  # seconds between dense poses; w between those
_APART = 0.8             # seconds between poses from which on w vanishes
_AGREE = 0.07            # metres: tolerated difference of the changes that two poses require of a bone
_MOST = 100.0            # largest w of different changes
_SAME = 1e-5    # metres: tolerance between equal bone lengths
_SAME_BODY = 0.008  # metres: tolerance between the bone lengths of one body in several poses
_BODY = 0.25    # plausible relative deviation of a bone from its usual length


def meet_poses(joints: Float[np.ndarray, "t 22 3"], poses: Float[np.ndarray, "t 22 3"], given: Bool[np.ndarray, " t"],
          lengths: Float[np.ndarray, " 22"], fps: float) -> Float[np.ndarray, "t 22 3"]:
  """Blends joints (T, 22, 3) into poses (T, 22, 3) in the given frames (T,), with bone lengths (22,), metres."""
  if not given.any() or len(joints) < 3:
    return joints
  off = np.where(given[:, None, None], poses - joints, 0.0)
  weights, result = _weights(off, np.flatnonzero(given), fps), np.empty_like(joints)
  for joint in range(len(lengths)):
    smooth = second_differences(len(joints), weights[:, joint])
    matrix = smooth + second_differences(len(joints))
    matrix[0] += (FADES * fps) ** -4.0
    pushed = -multiply_banded(smooth, joints[:, joint])
    result[:, joint] = joints[:, joint] + solve_banded(matrix, pushed, off[:, joint], given)
  return with_lengths(result, dataclasses.replace(HUMANML3D, bone_lengths=lengths))


def _weights(off: np.ndarray, frames: np.ndarray, fps: float) -> np.ndarray:
  """w (T - 2, 22), from the offsets (T, 22, 3) of the motion in the frames (N,) of poses."""
  bone_off = off - off[:, np.maximum(HUMANML3D.parents, 0)]  # of each bone; position of the pelvis
  bone_off[:, 0] = off[:, 0]
  weights = np.zeros((len(off), off.shape[1]))
  for first, last in zip(frames[:-1], frames[1:]):
    gap = (last - first) / fps
    apart = np.linalg.norm(bone_off[last] - bone_off[first], axis=-1) / _AGREE
    weights[first:last] = (_OWN / (1 + (gap / _THICK) ** 8) + np.minimum(apart ** 4, _MOST) / (1 + (gap / _APART) ** 8))
  return np.maximum(weights[:-2], weights[1:-1])


def lengths_from_poses(signal: ControlSignal) -> Float[np.ndarray, " 22"] | None:
  """Bone lengths (22,) of the body in the whole-body poses of a signal (1, T); None if there are no such poses, or if
  they show several bodies or implausible bones."""
  whole = np.asarray(signal.given)[0].all((-1, -2))
  if not whole.any():
    return None
  lengths = bone_lengths(np.asarray(signal.positions, np.float64)[0, whole], HUMANML3D)
  median = np.median(lengths, axis=0)
  usual = HUMANML3D.bone_lengths
  person = (np.abs(median - usual) <= _BODY * usual + 0.02).all()
  return median if person and np.abs(lengths - median).max() < _SAME_BODY else None


def with_build(joints: Float[np.ndarray, "t 22 3"], lengths: Float[np.ndarray, " 22"] | None
             ) -> Float[np.ndarray, "t 22 3"]:
  """The motion retargeted to bone lengths (22,), feet pinned; unchanged for None or equal lengths."""
  if lengths is None or np.abs(bone_lengths(joints, HUMANML3D) - lengths).max() < _SAME:
    return joints
  result = retarget(joints, dataclasses.replace(HUMANML3D, bone_lengths=lengths))
  low = lambda body: np.percentile(body[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min(1), 5)
  return result + [0, low(joints) - low(result), 0]


# --- banded matrices -----------------------------------------------------------------------------------------------


def second_differences(count: int, weights: Float[np.ndarray, " n"] | float = 1.0) -> Float[np.ndarray, "3 t"]:
  """Lower bands (3, T) of the quadratic form sum of weights (T - 2,) times squared second differences, T = count."""
  bands = np.zeros((3, count))
  if count > 2:
    for shift, factor in ((0, 1.0), (1, 4.0), (2, 1.0)):
      bands[0, shift:count - 2 + shift] += factor * weights
    bands[1, :count - 2] -= 2.0 * weights
    bands[1, 1:count - 1] -= 2.0 * weights
    bands[2, :count - 2] += weights
  return bands


def multiply_banded(bands: Float[np.ndarray, "3 t"], x: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "t p"]:
  """Product of the symmetric matrix of lower bands (3, T) and x (T, P)."""
  result = bands[0][:, None] * x
  for apart in (1, 2):
    low = bands[apart, :-apart, None]
    result[apart:] += low * x[:-apart]
    result[:-apart] += low * x[apart:]
  return result


def solve_banded(bands: Float[np.ndarray, "3 t"], pushed: Float[np.ndarray, "t k"], values: Float[np.ndarray, "t k"],
           given: Bool[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
  """Solves bands x = pushed for x (T, K) with x = values in the given rows (T,). Modifies bands and pushed."""
  from scipy.linalg import solveh_banded
  count, fixed = len(values), np.flatnonzero(given)
  for offset in (1, 2):  # given values move to the right-hand side
    for frame in fixed:
      for other, low in ((frame + offset, frame), (frame - offset, frame - offset)):
        if 0 <= other < count:
          pushed[other] -= bands[offset, low] * values[frame]
          bands[offset, low] = 0
  bands[0, fixed], pushed[fixed] = 1.0, values[fixed]
  return solveh_banded(bands, pushed, lower=True)
