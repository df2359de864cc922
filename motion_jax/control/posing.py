"""Whole poses met: a body goes smoothly from one to the next, the more of its own motion in it, the more the poses
agree with that and the farther they are apart.

For each joint, with places x(t) of the motion and y(t) those looked for, y = x + e,

  min  sum_t |e_(t+1) - 2 e_t + e_(t-1)|^2  +  w_t |y_(t+1) - 2 y_t + y_(t-1)|^2  +  pull |e|^2,   y = pose where given;

w is large between poses that come thick, where the way from one to the next is known better than any model makes it,
and between poses that want very different changes of the motion. Bones are then made as long as they were. numpy,
float64.
"""
import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from motion_jax.control import bands
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D

FADES = 0.3              # seconds over which what is done for one frame comes and goes
_THICK, _OWN = 0.25, 3.0  # seconds between poses that come thick; w between those
_APART = 0.8             # seconds between poses from which the motion is left its own way
_AGREE = 0.07            # metres by which changes that two poses want of a bone may differ
_MOST = 100.0            # w at the most


def posed(joints: Float[np.ndarray, "t 22 3"], poses: Float[np.ndarray, "t 22 3"], given: Bool[np.ndarray, " t"],
          lengths: Float[np.ndarray, " 22"], fps: float) -> Float[np.ndarray, "t 22 3"]:
  """Joints (T, 22, 3) that are in poses (T, 22, 3) where those are given (T,); bones of these lengths (22,), metres."""
  if not given.any() or len(joints) < 3:
    return joints
  off = np.where(given[:, None, None], poses - joints, 0.0)
  weights, result = _weights(off, np.flatnonzero(given), fps), np.empty_like(joints)
  for joint in range(len(lengths)):
    smooth = bands.second_differences(len(joints), weights[:, joint])
    matrix = smooth + bands.second_differences(len(joints))
    matrix[0] += (FADES * fps) ** -4.0
    pushed = -bands.times(smooth, joints[:, joint])
    result[:, joint] = joints[:, joint] + bands.solved(matrix, pushed, off[:, joint], given)
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
