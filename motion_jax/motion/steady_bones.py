"""Prevent bones from flipping where the joints of a network are ambiguous.

The mean of two poses of an arm can pass through the shoulder: the decoded upper arm becomes short, and its direction
flips between frames once the bone length is restored. A turn is trusted to the degree that the bone has its full
length; the turn of a shorter bone is spread over two frames before and as many after as needed. Trusted directions stay
bit for bit.
"""
import numpy as np

from motion_jax.motion.layering import turned_towards
from motion_jax.motion.skeleton import Skeleton
from motion_jax.shapes import Float

_MOST = 30.0             # degrees a frame: largest turn of an ambiguous bone
_DOUBT = (0.6, 1.0)      # parts of a bone's length: below the first its direction is ignored, from the second trusted


class SteadyBones:
  """Corrects a motion chunk by chunk; each frame needs the two decoded frames before and after it."""

  def __init__(self, skeleton: Skeleton) -> None:
    self._parents = np.array(skeleton.parents[1:])
    self._lengths = np.maximum(np.asarray(skeleton.bone_lengths, np.float64)[1:], 1e-9)
    self._skeleton = skeleton
    self._last: np.ndarray | None = None  # directions (B, 3) of the frame before, corrected; `_came`: as decoded
    self._came: np.ndarray | None = None

  def __call__(self, joints: Float[np.ndarray, "n j 3"], decoded: Float[np.ndarray, "n+4 j 3"]
               ) -> Float[np.ndarray, "n j 3"]:
    """Corrects joints (n, J, 3) with restored bone lengths; decoded (n + 4, J, 3): two frames more at either end."""
    bones = decoded[:, 1:] - decoded[:, self._parents]
    length = np.linalg.norm(bones, axis=-1)
    raw = bones / np.maximum(length, 1e-9)[..., None]
    sure = np.clip((length / self._lengths - _DOUBT[0]) / (_DOUBT[1] - _DOUBT[0]), 0, 1)
    doubted = (1 - np.minimum(sure[:-1], sure[1:])) * _angle(raw[:-1], raw[1:])  # degrees of the step after a frame
    here, ahead = doubted[1:-2] > _MOST, doubted[2:-1] + doubted[3:] > 1.5 * _MOST
    directions = joints[:, 1:] - joints[:, self._parents]
    directions = directions / np.maximum(np.linalg.norm(directions, axis=-1), 1e-9)[..., None]
    corrected = directions.copy()
    for t in range(len(joints)):
      last, came = self._last, self._came
      self._came = directions[t]
      if last is not None and came is not None and ((here[t] | ahead[t]).any() or (last != came).any()):
        aim = np.where(ahead[t][:, None], raw[t + 4], directions[t])
        believed = np.minimum(sure[t + 1], sure[t + 2]) * _angle(came, directions[t])
        gap = _angle(last, aim)
        part = np.minimum((_MOST + believed) / np.maximum(gap, 1e-9), 1)
        turned = turned_towards(last, aim, part)
        corrected[t] = np.where((part < 1)[:, None], turned, aim)
      self._last = corrected[t]
    return self._built(joints, directions, corrected)

  def _built(self, joints, directions, corrected):
    """Rebuilds joints from corrected directions, from the root to the ends of the limbs."""
    changed = (corrected != directions).any(-1)
    if not changed.any():
      return joints
    result = joints.copy()
    for joint, parent in enumerate(self._parents, start=1):
      bone = joints[:, joint] - joints[:, parent]
      length = np.linalg.norm(bone, axis=-1, keepdims=True)
      bone = np.where(changed[:, joint - 1, None], corrected[:, joint - 1] * length, bone)
      result[:, joint] = result[:, parent] + bone
    same = ~changed.any(1)
    result[same] = joints[same]
    return result


def _angle(a, b):
  """Angle between unit vectors (..., 3), degrees."""
  return np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1)))
