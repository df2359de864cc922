"""Spans of a motion that meet constraints, between frames that stay equal bit for bit. numpy."""
from collections.abc import Sequence

import numpy as np

from motion_jax.control.compiling import angle_of, compile
from motion_jax.control.constraints import Constraint
from motion_jax.control.keys import frames_of, joint_of, within_reach, without_slack
from motion_jax.control.project import project
from motion_jax.control.signal import ControlSignal
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.shapes import Bool, Float, Num
from motion_jax.utils.errors import InputError

_MISSED = 0.01  # metres off a key that are reported
_BESIDE = 10  # kept frames on either side of a span that the projection includes


def project_frames(joints: Num[np.ndarray, "t 22 3"], constraints: Sequence[Constraint], new: Bool[np.ndarray, " t"],
                   fps: float = 20.0) -> Float[np.ndarray, "t 22 3"]:
  """Changes the frames of joints (T, 22, 3) that are new (T,) to meet the constraints; all others stay bit for bit.

  A key that no body can reach in time is met as nearly as one can. Raises InputError for a constraint at another frame.
  float32.
  """
  count = len(joints)
  check_inside(constraints, new, fps)
  first, last = np.flatnonzero(new)[[0, -1]]
  window = slice(max(first - _BESIDE, 0), min(last + 1 + _BESIDE, count))
  kept, near = ~new[window], np.asarray(joints[window], np.float64)
  keys, _ = within_reach(without_slack(constraints, joints, fps, new), joints, new, fps)
  signal = compile(keys, count, fps, joints).slice_frames(window.start, window.stop)
  fixed = ControlSignal(
      np.where(kept[:, None, None], near, signal.positions[0])[None].astype(np.float32),
      signal.given | kept[:, None, None],
      np.where(kept, angle_of(near), signal.heading[0])[None].astype(np.float32), signal.heading_given | kept)
  result = np.array(joints, np.float32)
  result[window][~kept] = project(near, fixed, fps, warn=False)[~kept]
  return result


def missed(joints: Num[np.ndarray, "t 22 3"], constraints: Sequence[Constraint], before: Num[np.ndarray, "t 22 3"],
           new: Bool[np.ndarray, " t"], fps: float = 20.0) -> list[str]:
  """A sentence for each key that joints (T, 22, 3), projected from `before` in its new frames (T,), miss, and why."""
  keys, notes = within_reach(without_slack(constraints, before, fps, new), before, new, fps)
  signal = compile(keys, len(joints), fps, joints)
  off = np.where(signal.given[0], signal.positions[0] - joints, 0)
  for frame, joint in np.argwhere(np.linalg.norm(off, axis=-1) > _MISSED)[:1]:
    notes.append(f"the key of {HUMANML3D.joints[joint].replace('_', ' ')} at {frame / fps:.2f} s (frame {frame}) is "
                 f"{np.linalg.norm(off[frame, joint]):.2f} m off: keys contradict one another, or the limbs are too "
                 "short; give one of them slack, or move it")
  return notes


def check_inside(constraints: Sequence[Constraint], new: Bool[np.ndarray, " t"], fps: float) -> None:
  """Raises InputError for a constraint at a frame that is not new (T,), or without a time."""
  for constraint in constraints:
    frames = frames_of(constraint, fps, len(new))
    if not frames:
      raise InputError(f"got a {constraint.kind} without times in an edit, expected keys: keyframe or effector")
    for frame in frames:
      if frame >= len(new) or not new[frame]:
        raise InputError(f"got a key of {joint_of(constraint)} at {frame / fps:.2f} s (frame {frame}), which is not "
                         f"among the frames to change; move it into the span, or widen the span")


def near_keys(constraints: Sequence[Constraint], count: int, fps: float, width: int) -> Bool[np.ndarray, " t"]:
  """(count,): the frames at most `width` frames from a key."""
  frames = np.arange(count)
  return np.any([np.abs(frames - frame) <= width for constraint in constraints
                 for frame in frames_of(constraint, fps, count)] or [np.zeros(count, bool)], axis=0)
