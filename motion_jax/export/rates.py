"""Clips at another frame rate: bones keep their lengths, and loops stay loops."""
import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import looping
from motion_jax.motion import rotations as rot
from motion_jax.motion.plausibility import check_rate
from motion_jax.motion.pose import pose_to_joints, to_pose


def at_rate(clip: Clip, fps: float) -> Clip:
  """A clip at `fps` frames a second, of the same length to less than a frame.

  Joint rotations and the root's path are interpolated along cubic splines (of quaternions, which are then unit again:
  the arc of slerp, without its corners at frames). Of a loop the last frame stays the last frame, so that it meets the
  first; its pace changes by less than half a frame over its length.
  """
  check_rate(fps, f"clip {clip.id!r}")
  if abs(fps - clip.fps) < 1e-6 or clip.num_frames < 2:
    return clip.replace(fps=fps)
  from scipy.interpolate import CubicSpline
  joints, steps = np.asarray(clip.joints, np.float64), clip.num_frames - 1
  pad = 0
  if looping.is_loop(joints, clip.skeleton):
    at = np.linspace(0, steps, max(1, round(steps * fps / clip.fps)) + 1)
    pad = looping.around(len(joints), clip.fps)
    joints = looping.rounds(joints, pad, looping.turn_of_round(joints, clip.skeleton))
  else:
    at = np.arange(int(np.floor(steps * fps / clip.fps + 1e-6)) + 1) * (clip.fps / fps)
  pose = to_pose(joints, clip.skeleton, clip.fps)
  spline = lambda values: CubicSpline(np.arange(len(joints)) - pad, values)(at)
  pose = pose._replace(root=spline(pose.root), shifts=spline(pose.shifts), rotations=rot.unit(spline(pose.rotations)))
  moved = pose_to_joints(pose, clip.skeleton).astype(np.float32)
  return clip.replace(joints=moved, fps=fps, features=None)
