"""The build of the body that poses were taken from: a motion that is to meet them takes it on. numpy, float64."""
import dataclasses

import numpy as np
from jaxtyping import Float

from motion_jax.control.signal import ControlSignal
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

_SAME = 1e-5    # metres between two bones that count as equally long
_AGREE = 0.008  # metres within which a bone's lengths in several poses are those of one body
_BODY = 0.25    # of a bone's usual length by which a person's may differ


def build_of(signal: ControlSignal) -> Float[np.ndarray, " 22"] | None:
  """Lengths of the bones that end in each joint, of the one body that all whole poses of a signal (1, T) show; None
  where there are no such poses, where they show several bodies, or none that a person has."""
  whole = np.asarray(signal.given)[0].all((-1, -2))
  if not whole.any():
    return None
  lengths = bone_lengths(np.asarray(signal.positions, np.float64)[0, whole], HUMANML3D)
  found = np.median(lengths, axis=0)
  usual = HUMANML3D.bone_lengths
  person = (np.abs(found - usual) <= _BODY * usual + 0.02).all()
  return found if person and np.abs(lengths - found).max() < _AGREE else None


def built_as(joints: Float[np.ndarray, "t 22 3"], lengths: Float[np.ndarray, " 22"] | None
             ) -> Float[np.ndarray, "t 22 3"]:
  """The motion on bones of these lengths, feet standing where they stood; as it is on its own, or where there are none.
  """
  if lengths is None or np.abs(bone_lengths(joints, HUMANML3D) - lengths).max() < _SAME:
    return joints
  made = retarget(joints, dataclasses.replace(HUMANML3D, bone_lengths=lengths))
  low = lambda body: np.percentile(body[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min(1), 5)
  return made + [0, low(joints) - low(made), 0]
