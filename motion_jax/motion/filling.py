"""New frames between kept ones: same bones, no jump at the borders, feet that stay where they stand.

A network remakes part of a motion and returns all of it, in its own place and within its own error. `fill_frames` takes
only the new frames: it aligns them rigidly to the kept neighbours, spreads what is left of the difference over the new
frames (inertialization, D. Bollo, GDC 2018), restores the bone lengths and pins the feet. Kept frames stay to the bit.
numpy, float64, whole clips.
"""
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Num

from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.planting import planted
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.splicing import Meeting, laid, meeting
from motion_jax.shapes import Array

_FADE = 0.6       # seconds in which a difference of pose fades
_MOST_DRIFT = 1.5  # metres a second that the speed of a joint, seen from the pelvis, is taken to differ at a border
_PAUSE = 2e-3     # metres a frame that a resting body counts as moving where a difference of place is spread
# Weights of the correction of a foot, as in `cleanup`: its change, the change of its change, and its size.
_EASE, _BEND, _PULL = 0.02, 0.05, 4e-3
_BESIDE = 4       # kept frames on either side that the legs' solution sees


class Border(NamedTuple):
  """What the kept frames say about the first frame behind them, or, with time reversed, before them."""
  aim: np.ndarray   # (J, 3) where it would be if the body kept its speed
  speed: np.ndarray  # (J, 3) a frame, away from the kept frames


def fill_frames(made: Num[Array, "t j 3"], given: Num[Array, "t j 3"], new: Bool[Array, " t"],
                skeleton: Skeleton = HUMANML3D, fps: float = 20.0, fix_body: bool = True
                ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3): those given where not new (T,), elsewhere those made, moved so that they continue the kept ones.

  skeleton: the bone lengths of given; made shows about the same body. fix_body: restore them in the new frames and pin
  feet that stand; without it the frames are only aligned and blended. Between two kept parts what is left of the
  difference of place and direction is spread over the frames in which the body moves. float64.
  """
  made, given, new = np.asarray(made, np.float64), np.asarray(given, np.float64), np.asarray(new, bool)
  if made.shape != given.shape or new.shape != made.shape[:1]:
    raise ValueError(f"got joints of shapes {made.shape} and {given.shape} with {new.shape} frames new or not; "
                     "expected the same frames of all")
  result = np.where(new[:, None, None], made, given)
  stand = feet_stand(made, fps, skeleton) | (feet_stand(given, fps, skeleton) & ~new[:, None])
  for first, past in runs_of(new):
    body = _between(made[first:past], _border(given, new, first - 1, 1), _border(given, new, past, -1), skeleton, fps)
    result[first:past] = body
    if fix_body:
      result[first:past] = with_lengths(body, skeleton)
      result[first:past] = _pinned(result, stand, first, past, skeleton)
  return result


def runs_of(flags: Bool[Array, " t"]) -> Iterator[tuple[int, int]]:
  """(first, past) of each run of True."""
  edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
  return zip(edges[::2].tolist(), edges[1::2].tolist())


def _border(given, new, last, way):
  """The Border at the kept frame `last`, from which new frames lead in the direction of way; None beyond the motion."""
  if not 0 <= last < len(given):
    return None
  before = last - way
  known = 0 <= before < len(given) and not new[before]
  speed = given[last] - given[before] if known else np.zeros_like(given[last])
  return Border(given[last] + speed, speed)


def _aligned(body, border, skeleton):
  """The new frames, turned about y and moved over the ground so that the first is where the kept ones lead."""
  second = min(1, len(body) - 1)
  theirs = np.stack([border.aim, border.aim + border.speed])
  return meeting(theirs, body[[0, second]], skeleton)


def _between(body, left, right, skeleton, fps):
  """The new frames (N, J, 3), moved to continue what is left and right of them, where there is something."""
  if left is None and right is None:
    return body
  if right is None:
    return _continued(body, left, skeleton, fps)
  if left is None:
    return _continued(body[::-1], right, skeleton, fps)[::-1]
  if len(body) == 1:
    return (left.aim + right.aim)[None] / 2
  ahead, back = _aligned(body, left, skeleton), _aligned(body[::-1], right, skeleton)
  one, other = laid(body, ahead), laid(body, back)
  turn = (back.yaw - ahead.yaw + np.pi) % (2 * np.pi) - np.pi
  travel = np.linalg.norm(np.diff(body[:, 0, [0, 2]], axis=0), axis=-1) + _PAUSE / skeleton.unit
  share = np.append(0, np.cumsum(travel)) / travel.sum()
  share = (share * share * (3 - 2 * share))[:, None]
  pose, paths = np.empty_like(body), []
  for i, frame in enumerate(one - _ground(one)[:, None]):
    pose[i] = laid(frame[None], Meeting(0.0, turn * share[i, 0], np.zeros(2), np.zeros(2)))[0]
  pose += _offsets(pose, left, skeleton, fps) + _offsets(pose[::-1], right, skeleton, fps)[::-1]
  for placed, border, time in ((one, left, 1), (other, right, -1)):
    path = _ground(placed)[::time]
    paths.append((path + _detour(path, border, skeleton, fps))[::time])
  return pose + ((1 - share) * paths[0] + share * paths[1])[:, None]


def _continued(body, border, skeleton, fps):
  """The new frames (N, J, 3) behind kept ones."""
  body = laid(body, _aligned(body, border, skeleton))
  path = _ground(body)
  pose = body - path[:, None]
  return pose + _offsets(pose, border, skeleton, fps) + (path + _detour(path, border, skeleton, fps))[:, None]


def _ground(body):
  """Where the root is over the ground, (N, 3) with heights of 0."""
  return body[:, 0] * [1, 0, 1]


def _seen(border):
  """A Border as the pelvis sees it: poses less their place on the ground."""
  return Border(border.aim - border.aim[0] * [1, 0, 1], border.speed - border.speed[0] * [1, 0, 1])


def _offsets(pose, border, skeleton, fps):
  """What to add to poses (N, J, 3) so that the first is where the kept ones lead, at their speed; it fades to 0."""
  border, second = _seen(border), min(1, len(pose) - 1)
  away, drift = border.aim - pose[0], border.speed - (pose[second] - pose[0])
  size = np.linalg.norm(drift, axis=-1, keepdims=True) * fps * skeleton.unit
  drift = drift * np.minimum(1, _MOST_DRIFT / np.maximum(size, 1e-9))
  width, s = _progress(len(pose), fps)
  s = s[:, None, None]
  return away * (1 - 3 * s ** 2 + 2 * s ** 3) + drift * width * s * (1 - s) ** 2


def _detour(path, border, skeleton, fps):
  """What to add to a path (N, 3) over the ground: it starts where the border leads at its speed, which fades for good,
  so that a body that comes to a stop does not go back."""
  border, second = Border(*(x[0] * [1, 0, 1] for x in border)), min(1, len(path) - 1)
  width, s = _progress(len(path), fps)
  s = s[:, None]
  drift = border.speed - (path[second] - path[0])
  return border.aim - path[0] + drift * width * (s - s ** 2 + s ** 3 / 3)


def _progress(count, fps):
  """(frames in which a difference fades, how much of that time has passed in each of count frames, 0 to 1)."""
  width = max(min(round(_FADE * fps), count - 1), 1)
  return width, np.minimum(np.arange(count) / width, 1)


def _pinned(joints, stand, first, past, skeleton):
  """The new frames first..past of joints (T, J, 3) with feet that do not slide while they stand; stand (T, 4)."""
  start, end = max(first - _BESIDE, 0), min(past + _BESIDE, len(joints))
  near, stand = joints[start:end], stand[start:end]
  inside = np.arange(start, end)
  fixed = (inside < first) | (inside >= past)
  feet = np.array([skeleton.left_feet, skeleton.right_feet])
  aims = near[:, feet].copy()  # (n, 2 feet, 2 points, 3)
  for side in range(2):
    for point in range(2):
      firm = (stand[1:, 2 * side + point] & stand[:-1, 2 * side + point]).astype(float)
      aims[:, side, point, [0, 2]] += _correction(aims[:, side, point, [0, 2]], firm, fixed)
  return planted(near, aims[:, :, 0], aims[:, :, 1], skeleton)[first - start:past - start]


def _correction(points, firm, fixed):
  """Moves e (N, 2) of a foot at points (N, 2) that minimize sum firm |step of (point + e)|^2 + ease |step of e|^2
  + bend |step of step of e|^2 + pull |e|^2, with e = 0 where fixed (N,)."""
  count = len(points)
  first = np.diff(np.eye(count), axis=0)
  second = np.diff(np.eye(count), n=2, axis=0)
  matrix = first.T @ ((firm + _EASE)[:, None] * first) + _BEND * second.T @ second + _PULL * np.eye(count)
  pushed = -first.T @ (firm[:, None] * (first @ points))
  free = ~fixed
  moves = np.zeros_like(points)
  moves[free] = np.linalg.solve(matrix[np.ix_(free, free)], pushed[free])
  return moves
