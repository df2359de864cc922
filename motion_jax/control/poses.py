"""Whole-body pose constraints: blend a motion into poses, and take over the bone lengths of their body.

For each joint, with positions x(t) of the motion and y(t) of the result, y = x + e,

  min  sum_t |e_(t+1) - 2 e_t + e_(t-1)|^2  +  w_t |y_(t+1) - 2 y_t + y_(t-1)|^2  +  pull |e|^2,   y = pose where given;

w is large between poses that are close in time, where interpolation is better than any model, and between poses that
require very different changes of the motion. Bone lengths are restored afterwards. Smoothness terms are banded
symmetric matrices (3, T): the diagonal and the two below it. numpy, float64.
"""
import dataclasses

import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.motion.retarget import retarget, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.shapes import Bool, Float

FADES = 0.3              # seconds over which what is done for one frame comes and goes
_THICK, _OWN = 0.25, 3.0  # seconds between poses that come thick; w between those
_APART = 0.8             # seconds between poses from which the motion is left its own way
_AGREE = 0.07            # metres by which changes that two poses want of a bone may differ
_MOST = 100.0            # w at the most
_SAME = 1e-5    # metres between two bones that count as equally long
_SAME_BODY = 0.008  # metres within which a bone's lengths in several poses are those of one body
_BODY = 0.25    # of a bone's usual length by which a person's may differ


def meet_poses(joints: Float[np.ndarray, "t 22 3"], poses: Float[np.ndarray, "t 22 3"], given: Bool[np.ndarray, " t"],
          lengths: Float[np.ndarray, " 22"], fps: float) -> Float[np.ndarray, "t 22 3"]:
  """Joints (T, 22, 3) that are in poses (T, 22, 3) where those are given (T,); bones of these lengths (22,), metres."""
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
  """w (T - 2, 22), given how far the motion is off (T, 22, 3) in the frames (N,) of poses."""
  own = off - off[:, np.maximum(HUMANML3D.parents, 0)]  # of each bone; of the pelvis where it is
  own[:, 0] = off[:, 0]
  found = np.zeros((len(off), off.shape[1]))
  for first, last in zip(frames[:-1], frames[1:]):
    gap = (last - first) / fps
    apart = np.linalg.norm(own[last] - own[first], axis=-1) / _AGREE
    found[first:last] = (_OWN / (1 + (gap / _THICK) ** 8) + np.minimum(apart ** 4, _MOST) / (1 + (gap / _APART) ** 8))
  return np.maximum(found[:-2], found[1:-1])


def lengths_from_poses(signal: ControlSignal) -> Float[np.ndarray, " 22"] | None:
  """Lengths of the bones that end in each joint, of the one body that all whole poses of a signal (1, T) show; None
  where there are no such poses, where they show several bodies, or none that a person has."""
  whole = np.asarray(signal.given)[0].all((-1, -2))
  if not whole.any():
    return None
  lengths = bone_lengths(np.asarray(signal.positions, np.float64)[0, whole], HUMANML3D)
  found = np.median(lengths, axis=0)
  usual = HUMANML3D.bone_lengths
  person = (np.abs(found - usual) <= _BODY * usual + 0.02).all()
  return found if person and np.abs(lengths - found).max() < _SAME_BODY else None


def with_build(joints: Float[np.ndarray, "t 22 3"], lengths: Float[np.ndarray, " 22"] | None
             ) -> Float[np.ndarray, "t 22 3"]:
  """The motion on bones of these lengths, feet standing where they stood; as it is on its own, or where there are none.
  """
  if lengths is None or np.abs(bone_lengths(joints, HUMANML3D) - lengths).max() < _SAME:
    return joints
  made = retarget(joints, dataclasses.replace(HUMANML3D, bone_lengths=lengths))
  low = lambda body: np.percentile(body[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min(1), 5)
  return made + [0, low(joints) - low(made), 0]


# --- banded matrices -----------------------------------------------------------------------------------------------


def second_differences(count: int, weights: Float[np.ndarray, " n"] | float = 1.0) -> Float[np.ndarray, "3 t"]:
  """Bands (3, T), lower form, of the sum of weights (T - 2,) times squared second differences of count numbers."""
  bands = np.zeros((3, count))
  if count > 2:
    for shift, factor in ((0, 1.0), (1, 4.0), (2, 1.0)):
      bands[0, shift:count - 2 + shift] += factor * weights
    bands[1, :count - 2] -= 2.0 * weights
    bands[1, 1:count - 1] -= 2.0 * weights
    bands[2, :count - 2] += weights
  return bands


def multiply_banded(bands: Float[np.ndarray, "3 t"], x: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "t p"]:
  """The symmetric matrix of these bands (3, T) times x (T, P)."""
  result = bands[0][:, None] * x
  for apart in (1, 2):
    low = bands[apart, :-apart, None]
    result[apart:] += low * x[:-apart]
    result[:-apart] += low * x[apart:]
  return result


def solve_banded(bands: Float[np.ndarray, "3 t"], pushed: Float[np.ndarray, "t k"], values: Float[np.ndarray, "t k"],
           given: Bool[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
  """x (T, K) with bands x = pushed where x is not given (T,) to be one of values. Makes changes in bands and pushed."""
  from scipy.linalg import solveh_banded
  count, fixed = len(values), np.flatnonzero(given)
  for offset in (1, 2):  # what is given moves to the other side of the equations
    for frame in fixed:
      for other, low in ((frame + offset, frame), (frame - offset, frame - offset)):
        if 0 <= other < count:
          pushed[other] -= bands[offset, low] * values[frame]
          bands[offset, low] = 0
  bands[0, fixed], pushed[fixed] = 1.0, values[fixed]
  return solveh_banded(bands, pushed, lower=True)
