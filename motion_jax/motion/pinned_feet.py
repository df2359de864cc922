"""Place the feet of a motion at given positions: legs bend, and the hips are lowered where a leg is too short.

For captured motion that is turned or joined (`root_paths`, `splicing`). numpy, whole clips.
"""
import numpy as np

from motion_jax.motion.cleanup import solve_legs
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Array, Bool, Float, Num


def pin_feet(joints: Num[Array, "t j 3"], ankles: Num[Array, "t 2 3"], toes: Num[Array, "t 2 3"],
            skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "t j 3"]:
  """Moves the left and right feet of joints (T, J, 3) to ankles, pointing to toes, both (T, 2, 3), within reach.

  Joints have the skeleton's bone lengths, and so has the result: a foot lies on the line from ankle to toes. Where a
  leg would become straighter than 0.995 of its length, and than it was, the hips are lowered. float64.
  """
  placed, now = np.array(joints, np.float64), np.zeros((len(joints), 2, 3))
  for side, (ankle, toe) in enumerate((skeleton.left_feet, skeleton.right_feet)):
    line = np.asarray(toes[:, side] - ankles[:, side], np.float64)
    length = np.linalg.norm(placed[:, toe] - placed[:, ankle], axis=-1, keepdims=True)
    now[:, side] = placed[:, ankle]
    placed[:, toe] = placed[:, ankle] + line * length / np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-9)
  return solve_legs(placed, ankles - now, skeleton)


def stands(joints: Num[Array, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D) -> Bool[np.ndarray, "t 2"]:
  """Whether the left and the right foot stand, by ankle or toes (`contacts.feet_stand`): (T, 2)."""
  flags = feet_stand(np.asarray(joints), fps, skeleton)
  return np.stack([flags[:, :2].any(1), flags[:, 2:].any(1)], 1)
