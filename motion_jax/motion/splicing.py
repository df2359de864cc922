"""Splice two motions: align them at similar poses, and join them without a jump.

`meeting` aligns two windows of frames on the ground and measures their distance (L. Kovar and others, Motion Graphs,
SIGGRAPH 2002); `spliced` joins them by inertialization (D. Bollo, GDC 2018): the offset at the border fades out of the
second motion, but not out of a foot while it stands. numpy, float64.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.motion.pinned_feet import pin_feet, stands
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, facing
from motion_jax.shapes import Array, Float, Num

REACH = 3   # frames compared before and after the frame at which two motions meet
_FADE = 9   # frames in which an offset fades
_STEP = (8, 14)  # shortest and longest final step of a walk, frames
_LIFT = 0.05     # metres by which the foot is lifted in that step
_AHEAD = 0.15    # metres: least distance ahead of the pelvis at which a foot lands


class Meeting(NamedTuple):
  """Alignment of a second window of frames to a first: turn by yaw (about y, from z to x) about `middle`, then move to
  `onto`. distance: root mean square distance after that, in the skeleton's unit."""
  distance: float
  yaw: float
  middle: np.ndarray  # (2,) x and z: weighted mean of the second window's points
  onto: np.ndarray    # (2,) the same of the first


def weights(skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, " j"]:
  """Weights (J,) of the joints in comparisons of poses; those of feet, which may not slide, are four times as large."""
  weight = np.ones(skeleton.num_joints)
  weight[list(skeleton.left_feet + skeleton.right_feet)] = 4.0
  return weight / weight.sum()


def meeting(first: Num[Array, "n j 3"], second: Num[Array, "n j 3"], skeleton: Skeleton = HUMANML3D) -> Meeting:
  """Aligns frames second (N, J, 3) with first by a turn about y and a move over the ground, in closed form.

  For points minus their weighted means: yaw = atan2(sum w (x z' - z x'), sum w (x x' + z z')).
  """
  weight = np.broadcast_to(weights(skeleton) / len(first), first.shape[:2])[..., None]
  fixed, moving = (np.asarray(x, np.float64)[..., [0, 2]] for x in (first, second))
  onto, middle = ((weight * x).sum((0, 1)) for x in (fixed, moving))
  (x, z), (u, v) = np.moveaxis(fixed - onto, -1, 0), np.moveaxis(moving - middle, -1, 0)
  w = weight[..., 0]
  yaw = float(np.arctan2((w * (x * v - z * u)).sum(), (w * (x * u + z * v)).sum()))
  match = Meeting(0.0, yaw, middle, onto)
  off = np.asarray(first, np.float64) - laid(second, match)
  return match._replace(distance=float(np.sqrt((weight * off ** 2).sum())))


def laid(joints: Num[Array, "t j 3"], at: Meeting) -> Float[np.ndarray, "t j 3"]:
  """Applies a Meeting to the second motion (T, J, 3)."""
  joints = np.array(joints, np.float64)
  x, z = np.moveaxis(joints[..., [0, 2]] - at.middle, -1, 0)
  sin, cos = np.sin(at.yaw), np.cos(at.yaw)
  joints[..., 0], joints[..., 2] = x * cos + z * sin + at.onto[0], z * cos - x * sin + at.onto[1]
  return joints


def spliced(first: Num[Array, "m j 3"], leave: int, second: Num[Array, "n j 3"], enter: int,
            skeleton: Skeleton = HUMANML3D, fade: int = _FADE) -> Float[np.ndarray, "t j 3"]:
  """Frames 0..leave of first, then frames enter + 1.. of second, aligned at second[enter] and first[leave].

  Both motions stand on the same floor, have the skeleton's bone lengths and `REACH` frames around leave and enter. The
  offset of pose and speed fades within `fade` frames; that of a standing foot stays until the foot is lifted.
  """
  near = [slice(at - REACH, at + REACH + 1) for at in (leave, enter)]
  then = laid(second, meeting(first[near[0]], second[near[1]], skeleton))
  return _joined(np.asarray(first, np.float64), leave, then, enter, skeleton, fade)


def stepped(walk: Num[Array, "m j 3"], leave: int, stand: Num[Array, "n j 3"], enter: int, side: int,
            skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "t j 3"]:
  """Stops a walk by a last step: frames 0..leave of walk, then frames enter + 1.. of stand.

  Foot `side` (0 left, 1 right) has just landed ahead of the body; the other foot is placed next to it, and the body
  comes to rest over both. With the frames of both reversed this is the first step of a walk.
  """
  walk, stand = np.asarray(walk, np.float64), np.asarray(stand, np.float64)
  foot = (skeleton.left_feet, skeleton.right_feet)[side][0]
  ahead, other = (facing(x, skeleton, 3.0)[at] for x, at in ((walk, leave), (stand, enter)))
  yaw = float(np.arctan2(ahead[0], ahead[2]) - np.arctan2(other[0], other[2]))
  then = laid(stand, Meeting(0.0, yaw, stand[enter, foot, [0, 2]], walk[leave, foot, [0, 2]]))
  behind = float(np.linalg.norm((walk[leave, 0] - then[enter, 0])[[0, 2]]))
  pace = float(np.linalg.norm((walk[leave, 0] - walk[leave - 1, 0])[[0, 2]]))
  # A longer fade overshoots: the body would have to move back.
  fade = int(np.clip(3 * behind / max(pace, 1e-9) - 1, *_STEP))
  return _joined(walk, leave, then, enter, skeleton, fade, 1 - side)


def landings(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> list[tuple[int, int]]:
  """(frame, side) of each landing of a foot ahead of a moving body (T, J, 3)."""
  joints = np.asarray(joints, np.float64)
  flags = stands(joints, skeleton.fps, skeleton)
  going = np.gradient(joints[:, 0][:, [0, 2]], axis=0)
  going = going / np.maximum(np.linalg.norm(going, axis=-1, keepdims=True), 1e-9)
  touchdowns = []
  for side, (foot, _) in enumerate((skeleton.left_feet, skeleton.right_feet)):
    ahead = ((joints[:, foot] - joints[:, 0])[:, [0, 2]] * going).sum(-1) * skeleton.unit
    touchdowns += [(int(frame), side) for frame in np.flatnonzero(flags[1:, side] & ~flags[:-1, side]) + 1
              if ahead[frame] > _AHEAD]
  return sorted(touchdowns)


def _joined(first, leave, then, enter, skeleton, fade, steps=None):
  """Frames 0..leave of first, then frames enter + 1.. of `then`, already aligned; steps: side of a foot that takes a
  step while the offset fades."""
  away = first[leave] - then[enter]
  drift = (first[leave] - first[leave - 1]) - (then[enter] - then[enter - 1])
  rest, free = then[enter + 1:], ~stands(then, skeleton.fps, skeleton)[enter + 1:]
  frames = np.arange(1, len(rest) + 1)
  fades = lambda k: (np.multiply.outer(_hermite(k, fade)[0], away) + np.multiply.outer(_hermite(k, fade)[1], drift))
  blended = with_lengths(rest + fades(frames), skeleton)
  aims = []
  for pair in zip(skeleton.left_feet, skeleton.right_feet):
    aim = rest[:, pair] + fades(frames)[:, pair]
    for side, joint in enumerate(pair):
      if side == steps:
        aim[:, side, 1] += _LIFT / skeleton.unit * np.sin(np.pi * np.minimum(frames / (fade + 1), 1)) ** 2
      else:
        lag = fades(np.cumsum(free[:, side]))[:, joint]
        aim[:, side, [0, 2]] = rest[:, joint][:, [0, 2]] + lag[:, [0, 2]]
    aims.append(aim)
  return np.concatenate([first[:leave + 1], pin_feet(blended, aims[0], aims[1], skeleton)])


def _hermite(k, fade):
  """Cubic fade: remaining share of an offset, and factor of an offset per frame, after k of `fade` frames."""
  s = np.minimum(np.asarray(k, np.float64) / (fade + 1), 1)
  return 1 - 3 * s ** 2 + 2 * s ** 3, (fade + 1) * s * (1 - s) ** 2
