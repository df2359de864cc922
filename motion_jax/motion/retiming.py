"""Change the frame rate (`resample`) or the pace (`retimed`) of a motion.

Gravity does not change with the pace: speeds scale with the rate, accelerations with its square. The rate of flights
therefore differs from 1 by at most a tenth. Standing feet do not slide. numpy, whole clips, float64.
"""
import numpy as np

from motion_jax.motion.pinned_feet import pin_feet
from motion_jax.motion.retarget import floor_height, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Array, Bool, Float, Num

FLIGHT = 0.1     # largest difference of a flight's rate from 1
_ALOFT = 0.05    # metres above the floor of the lowest joint of both feet
_BESIDE = 0.2    # seconds before and after a flight that are played at its rate
_CHANGE = 0.1    # seconds, sigma of the transition from one rate to another


def resample(values: Num[np.ndarray, " t *frame"], fps: float, to_fps: float, smooth: bool = False
             ) -> Num[np.ndarray, " n *frame"]:
  """Resamples values (T, ...) at times k / fps to times k / to_fps within the same duration: (N, ...).

  Linear interpolation, or with `smooth` cubic splines.
  """
  seconds = (len(values) - 1) / fps
  at = np.arange(int(np.floor(seconds * to_fps + 1e-6)) + 1) * (fps / to_fps)
  if smooth and len(values) > 1:
    from scipy.interpolate import CubicSpline
    return CubicSpline(np.arange(len(values)), values)(at)
  first = np.minimum(np.floor(at + 1e-9).astype(int), len(values) - 1)
  weight = np.clip(at - first, 0, 1).reshape((-1,) + (1,) * (values.ndim - 1))
  return values[first] * (1 - weight) + values[np.minimum(first + 1, len(values) - 1)] * weight


def retimed(joints: Num[Array, "t j 3"], rate: float, skeleton: Skeleton = HUMANML3D, fps: float = 20.0
            ) -> Float[np.ndarray, "n j 3"]:
  """Joints (T, J, 3) played `rate` times as fast, flights within a tenth of their original pace: (N, J, 3).

  Joints and result have the skeleton's bone lengths.
  """
  from scipy.interpolate import CubicSpline
  from scipy.ndimage import binary_dilation
  joints = np.asarray(joints, np.float64)
  if not len(joints):
    return joints
  flight = binary_dilation(aloft(joints, skeleton), iterations=max(1, round(_BESIDE * fps)))
  rates = np.where(flight, np.clip(rate, 1 - FLIGHT, 1 + FLIGHT), rate)
  rates = gaussian_filter1d(rates.astype(float), _CHANGE * fps, mode="nearest", truncate=_BESIDE / _CHANGE)
  clock = np.append(0.0, np.cumsum((1 / rates[1:] + 1 / rates[:-1]) / 2))  # when each frame is played
  when = np.interp(np.arange(int(clock[-1] + 1e-9) + 1), clock, np.arange(len(joints)))
  moved = CubicSpline(np.arange(len(joints)), joints)(when) if len(joints) > 1 else joints
  feet = np.stack([moved[:, list(pair)] for pair in zip(skeleton.left_feet, skeleton.right_feet)])
  return pin_feet(with_lengths(moved, skeleton), feet[0], feet[1], skeleton)


def aloft(joints: Num[np.ndarray, "t j 3"], skeleton: Skeleton = HUMANML3D) -> Bool[np.ndarray, " t"]:
  """Mask (T,) of the frames in which no foot is on the ground."""
  lowest = joints[:, list(skeleton.left_feet + skeleton.right_feet), 1].min(1)
  return (lowest - floor_height(joints, skeleton)) * skeleton.unit > _ALOFT
