"""Clips brought from one figure to another."""
import numpy as np

from motion_jax.data.mocap.capture import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.transfer import from_22


def on_skeleton(clip, skeleton):
  """A clip of 22 joints on another figure, at that figure's rate."""
  if clip.skeleton is not HUMANML3D:
    raise ValueError(f"clip {clip.id!r} is on skeleton {clip.skeleton.name!r}; only clips of HumanML3D's 22 joints go "
                     f"to {skeleton.name!r}")
  joints = resample(clip.joints.astype(np.float64), clip.fps, skeleton.fps)
  return clip.replace(joints=from_22(joints, skeleton, skeleton.fps).astype(np.float32), fps=skeleton.fps,
                      skeleton=skeleton)
