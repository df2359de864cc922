"""Lean the trunk sideways, forward or back: the spine bends evenly, pelvis and legs stay."""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.shapes import Float, Num

_SPINE = (0, *(HUMANML3D.joints.index(name) for name in ("spine1", "spine2", "spine3")))


def lean(joints: Num[np.ndarray, "t j 3"], left: float, ahead: float, degrees: Num[np.ndarray, " t"]
         ) -> Float[np.ndarray, "t j 3"]:
  """Leans the trunk of joints (T, J, 3) of `HUMANML3D` by degrees (T,) more. float32.

  left, ahead: direction relative to the facing direction, 1 to the left and -1 to the right, 1 forward and -1 back.
  Pelvis, first and second spine joint turn by a third of the angle each; bone lengths stay.
  """
  result = np.array(joints, np.float64)
  forward = facing(result)
  side = np.stack([forward[:, 2], 0 * forward[:, 0], -forward[:, 0]], -1)
  axis = rot.unit(ahead * side - left * forward)
  half = np.radians(degrees)[:, None] / 2 / (len(_SPINE) - 1)
  turn = np.concatenate([np.cos(half), np.sin(half) * axis], -1)
  for pivot, above in zip(_SPINE, _SPINE[1:]):
    moved = [above, *HUMANML3D.descendants(above)]
    result[:, moved] = result[:, [pivot]] + rot.rotate(turn[:, None], result[:, moved] - result[:, [pivot]])
  return result.astype(np.float32)


def leans(joints: Num[np.ndarray, "t j 3"], left: float, ahead: float) -> Float[np.ndarray, " t"]:
  """Lean of the trunk (T,) in degrees, in a direction as in `lean`."""
  line = np.asarray(joints[:, HUMANML3D.joints.index("neck")] - joints[:, 0], np.float64)
  forward = facing(np.asarray(joints, np.float64))
  there = left * (line[:, 0] * forward[:, 2] - line[:, 2] * forward[:, 0]) + ahead * (
      line[:, 0] * forward[:, 0] + line[:, 2] * forward[:, 2])
  return np.degrees(np.arctan2(there, line[:, 1]))

