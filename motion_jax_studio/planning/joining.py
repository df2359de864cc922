"""Join motions that were sampled independently: leave each one near its end, and continue with the next one from there.

Similar poses are blended (`splicing.spliced`). A walk that meets a standing pose stops with a step that brings the
other foot next to the one that has just landed (`splicing.stepped`); a walk starts with such a step, reversed in time.
"""
from collections.abc import Sequence

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.splicing import REACH, laid, landings, meeting, spliced, stepped
from motion_jax.shapes import Array, Float, Num

SLACK = 48       # spare frames of each part, so that it can be left and entered where the poses fit
_AROUND = 14     # most frames between where a part should end and where it is left
_INTO = 14       # most frames from the beginning of a part to where it is entered
_MEETS = 0.1     # metres, largest root mean square distance of poses that fit, with fourfold weight of the feet
_MOVES = 0.4     # least speed over the ground of a walking body, metres per second
_LATER = 0.002   # cost of each frame by which a part is left or entered elsewhere, in metres of that distance
_QUICKLY, _SLOWLY = 9, 14  # frames of a blend, between poses that fit and between others


def joined(parts: Sequence[Num[Array, "_ j 3"]], ends: Sequence[int], skeleton: Skeleton = HUMANML3D
           ) -> tuple[Float[np.ndarray, "n j 3"], list[int]]:
  """Join parts (T_i, J, 3) in sequence; returns (joints of at most ends[-1] frames, the frame past each part).

  ends: frame at which each part should end; parts have about `SLACK` frames more than they fill. Raises ValueError for
  parts that are too short to be joined.
  """
  joints, past = np.asarray(parts[0], np.float64), []
  for part, end in zip(parts[1:], ends):
    if min(len(joints), len(part)) < 2 * REACH + 2:
      raise ValueError(f"got parts of {len(joints)} and {len(part)} frames to join, expected {2 * REACH + 2} or more")
    joints, at = _continued(joints, np.asarray(part, np.float64), end, skeleton)
    past.append(int(at))
  joints = joints[:ends[-1]]
  return joints, [*past, len(joints)]


def _continued(first, second, end, skeleton):
  """(`first` continued by `second`, the frame at which `second` begins). end: the frame where that should be."""
  low, high = max(REACH, end - _AROUND), min(len(first) - REACH - 1, end + _AROUND)
  leaves = range(min(low, high), high + 1, 2)
  enters = range(REACH, min(len(second) - REACH, REACH + _INTO), 2)
  reach = np.arange(-REACH, REACH + 1)
  meetings = [(meeting(first[leave + reach], second[enter + reach], skeleton).distance * skeleton.unit, leave, enter)
           for leave in leaves for enter in enters]
  distance, leave, enter = min(meetings, key=lambda option: option[0] + _LATER * (abs(option[1] - end) + option[2]))
  goes, starts = _goes(first, leave, skeleton), _goes(second, enter, skeleton)
  if distance > _MEETS and goes and not starts:
    stops = [at for at in landings(first, skeleton) if low <= at[0] <= high]
    if stops:
      leave, side = min(stops, key=lambda at: abs(at[0] - end))
      return stepped(first, leave, second, REACH, side, skeleton), leave + 1
  if distance > _MEETS and starts and not goes:
    last = len(second) - 1
    begins = [(last - frame, side) for frame, side in landings(second[::-1], skeleton)
              if REACH <= last - frame < REACH + 2 * _INTO]
    if begins:
      (enter, side), leave = min(begins), min(max(end, low), high)
      stepped_joints = stepped(second[::-1], last - enter, first[:leave + REACH + 1][::-1], REACH, side,
                               skeleton)[::-1]
      # Reversed in time, `stepped` leaves the walk in place and moves the pose before it: undo that by moving all back.
      kept = slice(0, max(leave - 2 * _SLOWLY, 2))
      return laid(stepped_joints, meeting(first[kept], stepped_joints[kept], skeleton)), leave
  return spliced(first, leave, second, enter, skeleton, _QUICKLY if distance <= _MEETS else _SLOWLY), leave + 1


def _goes(joints, frame, skeleton):
  """Whether the body moves over the ground around a frame."""
  near = joints[max(frame - REACH, 0):frame + REACH + 1, 0][:, [0, 2]]
  return np.linalg.norm(near[-1] - near[0]) / max(len(near) - 1, 1) * skeleton.fps * skeleton.unit > _MOVES
