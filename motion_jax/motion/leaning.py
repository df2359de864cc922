"""Lean the trunk of a body to a side, ahead or back: the spine bends evenly, pelvis and legs stay."""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.shapes import Float, Num

_SPINE = (0, *(HUMANML3D.joints.index(name) for name in ("spine1", "spine2", "spine3")))


def lean(joints: Num[np.ndarray, "t j 3"], left: float, ahead: float, degrees: Num[np.ndarray, " t"]
         ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) of `HUMANML3D` whose trunk leans by degrees (T,) more, seen from where the body faces. float32.

  left, ahead: the way that it leans, 1 to the left and -1 to the right, 1 ahead and -1 back. A third of the angle is
  turned at each joint from the pelvis to the second of the spine, with all that is above it; bones keep their lengths.
  """
  made = np.array(joints, np.float64)
  forward = facing(made)
  side = np.stack([forward[:, 2], 0 * forward[:, 0], -forward[:, 0]], -1)
  axis = rot.unit(ahead * side - left * forward)
  half = np.radians(degrees)[:, None] / 2 / (len(_SPINE) - 1)
  turn = np.concatenate([np.cos(half), np.sin(half) * axis], -1)
  for pivot, above in zip(_SPINE, _SPINE[1:]):
    moved = [above, *_below(above)]
    made[:, moved] = made[:, [pivot]] + rot.rotate(turn[:, None], made[:, moved] - made[:, [pivot]])
  return made.astype(np.float32)


def leans(joints: Num[np.ndarray, "t j 3"], left: float, ahead: float) -> Float[np.ndarray, " t"]:
  """Degrees (T,) by which the trunk leans to a way, as in `lean`."""
  line = np.asarray(joints[:, HUMANML3D.joints.index("neck")] - joints[:, 0], np.float64)
  forward = facing(np.asarray(joints, np.float64))
  there = left * (line[:, 0] * forward[:, 2] - line[:, 2] * forward[:, 0]) + ahead * (
      line[:, 0] * forward[:, 0] + line[:, 2] * forward[:, 2])
  return np.degrees(np.arctan2(there, line[:, 1]))


def _below(joint):
  """The joints that hang on a joint."""
  children = [child for child, parent in enumerate(HUMANML3D.parents) if parent == joint]
  return [*children, *(one for child in children for one in _below(child))]
