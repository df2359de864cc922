"""Motions that were made apart become one: each is left about where it should end, and the next is laid behind it.

Where two poses meet they are laid over each other (`splicing.spliced`); a walk comes to rest by the step that sets its
other foot beside the one that has come down, and begins with such a step, time turned round (`splicing.stepped`).
"""
from collections.abc import Sequence

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.splicing import REACH, laid, landings, meeting, spliced, stepped
from motion_jax.shapes import Array, Float, Num

SLACK = 48       # frames that a part should have beyond those that it is to fill, to be left and entered where it fits
_AROUND = 14     # frames before and after where a part should end in which it may be left
_INTO = 14       # frames from its beginning in which the next may be entered
_MEETS = 0.1     # root mean square distance of poses that meet, feet four times; metres
_MOVES = 0.4     # metres a second over the ground of a body that goes somewhere
_LATER = 0.002   # what leaving or entering a frame off counts, in metres of that distance
_QUICKLY, _SLOWLY = 9, 14  # frames in which what is off fades, and of poses that do not meet


def joined(parts: Sequence[Num[Array, "_ j 3"]], ends: Sequence[int], skeleton: Skeleton = HUMANML3D
           ) -> tuple[Float[np.ndarray, "n j 3"], list[int]]:
  """(joints of parts (T_i, J, 3) one after the other, ends[-1] frames at the most, the frame past each part).

  ends: where each part should end, in frames from the beginning; each has about `SLACK` frames more than it fills.
  Raises ValueError for parts too short to be joined.
  """
  made, past = np.asarray(parts[0], np.float64), []
  for part, end in zip(parts[1:], ends):
    if min(len(made), len(part)) < 2 * REACH + 2:
      raise ValueError(f"got parts of {len(made)} and {len(part)} frames to join, expected {2 * REACH + 2} or more")
    made, at = _behind(made, np.asarray(part, np.float64), end, skeleton)
    past.append(int(at))
  made = made[:ends[-1]]
  return made, [*past, len(made)]


def _behind(first, second, end, skeleton):
  """(second behind first, the frame at which it begins)."""
  low, high = max(REACH, end - _AROUND), min(len(first) - REACH - 1, end + _AROUND)
  leaves = range(min(low, high), high + 1, 2)
  enters = range(REACH, min(len(second) - REACH, REACH + _INTO), 2)
  reach = np.arange(-REACH, REACH + 1)
  found = [(meeting(first[leave + reach], second[enter + reach], skeleton).distance * skeleton.unit, leave, enter)
           for leave in leaves for enter in enters]
  distance, leave, enter = min(found, key=lambda one: one[0] + _LATER * (abs(one[1] - end) + one[2]))
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
      made = stepped(second[::-1], last - enter, first[:leave + REACH + 1][::-1], REACH, side,
                     skeleton)[::-1]
      # Turned round in time the walk stays where it was and what is before it was laid: all goes back to that.
      kept = slice(0, max(leave - 2 * _SLOWLY, 2))
      return laid(made, meeting(first[kept], made[kept], skeleton)), leave
  return spliced(first, leave, second, enter, skeleton, _QUICKLY if distance <= _MEETS else _SLOWLY), leave + 1


def _goes(joints, frame, skeleton):
  """Whether a body goes somewhere around a frame."""
  near = joints[max(frame - REACH, 0):frame + REACH + 1, 0][:, [0, 2]]
  return np.linalg.norm(near[-1] - near[0]) / max(len(near) - 1, 1) * skeleton.fps * skeleton.unit > _MOVES
