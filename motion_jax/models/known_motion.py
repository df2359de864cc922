"""A motion that exists, made ready for a model to go on from or to edit."""
import numpy as np
from jaxtyping import Float

from motion_jax.data.clip import Clip
from motion_jax.data.mocap.capture import resample
from motion_jax.motion import plausibility
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import Skeleton, bone_lengths

_OTHER_BONES = 5e-3  # metres that a body's bones may differ from the skeleton's before it is retargeted


def on_our_body(clip: Clip, fps: float, skeleton: Skeleton) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3), float64, at the model's frame rate and with the bones that it knows.

  A body whose bones are the skeleton's (to 5 mm) stays exactly as it is; others are retargeted.
  """
  if clip.skeleton is not skeleton:
    raise ValueError(f"clip {clip.id!r} has the skeleton {clip.skeleton.name!r}, the model moves {skeleton.name!r}")
  plausibility.check(clip.joints, clip.skeleton, clip.fps, f"clip {clip.id!r}")
  joints = np.asarray(clip.joints, np.float64)
  if abs(clip.fps - fps) > 1e-3:
    joints = resample(joints, clip.fps, fps)
  if np.abs(bone_lengths(joints, skeleton) - skeleton.bone_lengths).max() * skeleton.unit > _OTHER_BONES:
    joints = retarget(joints, skeleton)
  return joints
