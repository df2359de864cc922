"""Foot-skate cleanup of generated joints: feet that stand still while they stand, bones of one length, no tremor.

A network's joints are right to a few millimetres, frame by frame; the eye sees what is left as sliding feet and tremor.
Nothing here changes what the motion does. Whole clips, numpy, float64.
"""
import numpy as np
from jaxtyping import Float, Num

from motion_jax.motion.retarget import bend_leg, firmness, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Array

_SMOOTH = 0.7       # sigma in frames: 2 Hz passes at 0.9, the tremor of frame against frame at 0.1
_EASE = 0.02        # how much the correction of a foot in the air resists change, against 1 for a foot that stands
_PULL = 1e-3        # how much every foot is drawn back to where it was


def clean_up(joints: Num[Array, "t j 3"], contacts: Num[Array, "t 4"] | None = None, skeleton: Skeleton = HUMANML3D
             ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) with planted feet, canonical bone lengths and no tremor, float32 of the same shape.

  contacts (T, 4): how surely ankle and toes stand, left then right, 0..1 (the contact columns of full features);
  without them slow and low feet are taken to stand.
  """
  from scipy.ndimage import gaussian_filter1d
  joints = np.asarray(joints, np.float64)
  if len(joints) < 3:
    return joints.astype(np.float32)
  body = with_lengths(gaussian_filter1d(joints, _SMOOTH, axis=0, mode="nearest"), skeleton)
  result = body.copy()
  for side, (leg, feet) in enumerate(zip(_legs(skeleton), (skeleton.left_feet, skeleton.right_feet))):
    if contacts is None:
      stands = np.maximum(firmness(body[:, feet[0]], skeleton.unit), firmness(body[:, feet[1]], skeleton.unit))
    else:
      sure = np.clip((np.asarray(contacts, np.float64)[:, 2 * side:2 * side + 2] - 0.3) / 0.4, 0, 1)
      stands = sure.max(1)[:-1]
    move = _plant(body[:, leg[2]], stands)
    under = np.minimum(body[:, list(feet), 1].min(1), 0.0)  # what has sunk into the floor comes up
    move[:, 1] = -gaussian_filter1d(under, 2.0, mode="nearest")
    bend_leg(body, result, leg, move, skeleton)
  return result.astype(np.float32)


def _legs(skeleton):
  """Leg chains without the root, left then right, as in skeleton.left_feet and right_feet."""
  chains = [chain[1:] for chain in skeleton.chains[:2]]
  return sorted(chains, key=lambda chain: chain[-1] != skeleton.left_feet[-1])


def _plant(path, stands):
  """How to move a foot's path (T, 3) over the ground so that it keeps still while it stands (T - 1,) in 0..1.

  The move e solves min sum stands |step of (path + e)|^2 + ease |step of e|^2 + pull |e|^2.
  """
  from scipy.linalg import solveh_banded
  move = np.zeros_like(path)
  both = stands + _EASE
  diagonal = _PULL + np.append(both, 0) + np.append(0, both)
  steps = np.diff(path[:, [0, 2]], axis=0) * stands[:, None]
  pushed = np.zeros((len(path), 2))
  pushed[:-1] += steps
  pushed[1:] -= steps
  move[:, [0, 2]] = solveh_banded(np.stack([np.append(0, -both), diagonal]), pushed)
  return move
