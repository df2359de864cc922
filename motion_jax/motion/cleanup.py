"""Foot-skate cleanup of generated joints: removes sliding feet, snapping knees and tremor.

The joints of a network have errors of a few millimetres per frame, visible as sliding feet and tremor, and the path of
its root need not match the steps of its legs. Four stages correct this:

1. Smooth slow joints (fast ones, such as a punch, keep their speed), restore the bone lengths, and prevent bones from
   flipping (`steady_bones`).
2. Move the root so that standing feet do not slide, if contact labels are given.
3. Pin each foot while it stands, and ease it back to its own path in the air.
4. Solve the legs for the pinned feet. Hips are lowered where a leg is too short; a leg is never straighter than 0.995
   of its length or than it was, because near a straight knee small moves of the foot are large turns of the knee.

A frame is final once the `LOOK_AHEAD` frames after it are known, in clips and streams alike. numpy, float64.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from motion_jax.motion.retarget import bend, floor_height, knee_side, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.steady_bones import SteadyBones
from motion_jax.shapes import Array, Float, Num

SMOOTHING = 0.7          # frames: 2 Hz passes at 0.91, 6 Hz at 0.43; at 0.4 0.99 and 0.89
_BRISK = (1.2, 2.4)      # m/s relative to the pelvis: smoothing decreases from the first speed, ends at the second
_SLIDES = 0.10           # m/s: speed of standing feet in real motion, which is not corrected
_NEAR = np.array([1, 2, 3, 2, 1]) / 9  # weights of neighbouring frames where a correction is spread in time
_HINT = 0.15             # certainty of contacts in neighbouring frames at which the root follows the feet completely
_STANDS = 0.40           # m/s at which the certainty of a labelled contact is halved
_SEEN = 0.20             # the same without labels: lower, so that a swinging foot is not pinned
_LOW = 0.16              # metres over the floor at which the certainty that a point of the foot stands is halved
_EASE, _BEND, _PULL = 0.02, 0.05, 4e-3  # weights of a foot's correction: its first and second difference, its size
_REACH, _SOFT = 0.995, 0.03  # parts of a leg's length: the straightest it may become, and the soft zone before
_LOWER = 0.08            # metres by which the hips are lowered at most
_AHEAD = (2, 2, 3, 3)    # frames that each stage looks ahead
LOOK_AHEAD = sum(_AHEAD)


def clean_up(joints: Num[Array, "t j 3"], contacts: Num[Array, "t 4"] | None = None, skeleton: Skeleton = HUMANML3D,
             fps: float | None = None, smoothing: float = SMOOTHING) -> Float[np.ndarray, "t j 3"]:
  """Pins standing feet, restores bone lengths and removes tremor: joints (T, J, 3) to float32 of the same shape.

  contacts (T, 4): certainty 0..1 that ankle and toes stand, left then right (the contact columns of full features),
  over a floor at y = 0. Without them slow and low feet are taken to stand, and the floor is where feet are lowest. fps:
  default the skeleton's. smoothing: standard deviation, in frames, of the Gaussian that slow joints are smoothed with;
  0 leaves them as they are, for a decoder that moves as real motion does. A `Cleaner` that gets the motion in pieces
  gives the same result.
  """
  joints = np.asarray(joints)
  if len(joints) < 3:
    return joints.astype(np.float32)
  floor = float(floor_height(joints, skeleton)) if contacts is None else 0.0
  cleaner = Cleaner(skeleton, fps, floor, smoothing)
  return np.concatenate([cleaner.push(joints, contacts), cleaner.flush()])


class Cleaner:
  """Cleans a motion while it is generated: pieces in, cleaned frames out, `LOOK_AHEAD` frames later.

    cleaner = Cleaner()
    for joints, contacts in pieces:
      show(cleaner.push(joints, contacts))   # frames (n, J, 3), at first fewer than were pushed
    show(cleaner.flush())                    # the last frames

  Time and memory per piece do not grow with the length of the motion.
  """

  def __init__(self, skeleton: Skeleton = HUMANML3D, fps: float | None = None, floor: float = 0.0,
               smoothing: float = SMOOTHING) -> None:
    """floor: height of the floor, in the skeleton's unit. smoothing: of slow joints, as in `clean_up`."""
    body = _Body(skeleton, fps or skeleton.fps, floor, smoothing)
    smooth, path, pin, reach = _AHEAD
    self._stages = [_Stage(_Smooth(body), 2, smooth), _Stage(_Path(body), 3, path), _Stage(_PinFeet(body), 1, pin),
                    _Stage(body.reach, 3, reach)]

  def push(self, joints: Num[Array, "n j 3"], contacts: Num[Array, "n 4"] | None = None) -> Float[np.ndarray, "m j 3"]:
    """Adds joints (n, J, 3) and returns the frames (m, J, 3), float32, that are final now."""
    count = len(joints)
    sure = np.ones((count, 2, 2))
    if contacts is not None:
      sure = np.clip((np.asarray(contacts, np.float64).reshape(-1, 2, 2) - 0.3) / 0.4, 0, 1)
    labelled = np.full(count, float(contacts is not None))
    frames = _Frames(np.asarray(joints, np.float64), sure, labelled, np.zeros((count, 2, 3)))
    for stage in self._stages:
      frames = stage.push(frames)
    return frames.joints.astype(np.float32)

  def flush(self) -> Float[np.ndarray, "m j 3"]:
    """Returns the remaining frames at the end of a motion."""
    rest: _Frames | None = None
    for stage in self._stages:
      rest = stage.flush(rest)
    assert rest is not None
    return rest.joints.astype(np.float32)


def solve_legs(joints: Num[Array, "t j 3"], move: Num[Array, "t 2 3"], skeleton: Skeleton = HUMANML3D
            ) -> Float[np.ndarray, "t j 3"]:
  """Moves the left and right foot of joints (T, J, 3) by move (T, 2, 3) and bends the legs to reach them. float64.

  This is the last stage of the cleanup, for whole motions whose feet the caller places (`pinned_feet`).
  """
  body, count = _Body(skeleton, skeleton.fps, -np.inf), len(joints)  # no floor: no foot is lifted onto it
  frames = _Frames(np.asarray(joints, np.float64), np.zeros((count, 2, 2)), np.zeros(count), np.asarray(move))
  return body.reach(_join(_repeat(frames, 0, 3), frames, _repeat(frames, -1, 3)), count).joints


class _Frames(NamedTuple):
  """n frames between two stages; feet are left and right, the points of a foot are ankle and toes."""
  joints: np.ndarray    # (n, J, 3)
  sure: np.ndarray      # (n, 2, 2) certainty that each point of each foot stands
  labelled: np.ndarray  # (n,) 1 where contacts are given, 0 where they follow from the motion
  move: np.ndarray      # (n, 2, 3) target position of each foot minus its position


class _Stage:
  """Applies a function of windows of frames to a stream: a frame is final once `ahead` more are known.

  function(n + back + ahead frames) -> the n frames after the first `back`. The first and the last frame of the motion
  are repeated beyond its ends.
  """

  def __init__(self, function: Callable[[_Frames, int], _Frames], back: int, ahead: int) -> None:
    self._function, self._back, self._ahead = function, back, ahead
    self._held: _Frames | None = None

  def push(self, frames: _Frames) -> _Frames:
    if not len(frames.joints):
      return frames
    held = _repeat(frames, 0, self._back) if self._held is None else self._held
    held = _join(held, frames)
    count = len(held.joints) - self._back - self._ahead
    if count <= 0:
      self._held = held
      return _cut(frames, 0, 0)
    self._held = _cut(held, count, None)
    return self._function(held, count)

  def flush(self, frames: _Frames | None) -> _Frames | None:
    """Adds the last frames and returns all that have not been returned yet."""
    ready = None if frames is None else self.push(frames)
    if self._held is None:
      return ready
    last = self.push(_repeat(self._held, -1, self._ahead)) if self._ahead else None
    return _join(*(part for part in (ready, last) if part is not None))


def _join(*parts: _Frames) -> _Frames:
  return _Frames(*map(np.concatenate, zip(*parts)))


def _cut(frames: _Frames, start: int, end: int | None) -> _Frames:
  return _Frames(*(array[start:end] for array in frames))


def _repeat(frames: _Frames, index: int, count: int) -> _Frames:
  return _Frames(*(np.repeat(array[[index]], count, axis=0) for array in frames))


def _weighted(x: np.ndarray, weights: Any) -> np.ndarray:
  """Sums of neighbours (n + len(weights) - 1, ...) -> (n, ...)."""
  count = len(x) - len(weights) + 1
  return sum(weight * x[k:k + count] for k, weight in enumerate(weights))


class _Body:
  """A skeleton's feet and legs, left then right, and the stages that depend on neighbouring frames only."""

  def __init__(self, skeleton: Skeleton, fps: float, floor: float, smoothing: float = SMOOTHING) -> None:
    self.skeleton, self.fps, self.floor, self.smoothing = skeleton, fps, floor, smoothing
    self.metre = 1 / skeleton.unit
    self.feet = np.array([skeleton.left_feet, skeleton.right_feet])
    legs = [chain[1:] for chain in skeleton.chains[:2]]  # without the root
    self.legs = sorted(legs, key=lambda leg: leg[-1] != skeleton.left_feet[-1])
    self.lengths = [(skeleton.bone_lengths[leg[1]], skeleton.bone_lengths[leg[2]]) for leg in self.legs]

  def smooth(self, frames: _Frames, count: int) -> np.ndarray:
    """Joints (count, J, 3) without tremor."""
    if self.smoothing < 0.02:  # neighbouring frames have no weight
      return frames.joints[2:2 + count]
    weights = np.exp(-0.5 * (np.arange(-2, 3) / self.smoothing) ** 2)
    smoothed = _weighted(frames.joints, weights / weights.sum())
    about = frames.joints - frames.joints[:, :1]
    # The speed over four frames, to which tremor adds little.
    speed = np.linalg.norm(about[4:] - about[:-4], axis=-1) / 4 * self.fps / self.metre
    brisk = np.clip((speed - _BRISK[0]) / (_BRISK[1] - _BRISK[0]), 0, 1)[..., None]
    now = _cut(frames, 2, 2 + count)
    return smoothed + (now.joints - smoothed) * brisk * brisk * (3 - 2 * brisk)

  def risen(self, frames: _Frames) -> np.ndarray:
    """Height (count,) by which to lift the body after its bone lengths have been restored."""
    # Restored from the pelvis down, bones end at other heights. The height of the feet is closer to the floor's than
    # that of the pelvis: the body is lifted or lowered as a whole, so that knees stay as bent as they were.
    lowest = lambda joints: joints[:, self.feet, 1].min((1, 2))
    risen = lowest(frames.joints) - lowest(with_lengths(frames.joints, self.skeleton))
    return _weighted(risen, _NEAR)

  def stands(self, frames: _Frames) -> tuple[np.ndarray, np.ndarray]:
    """Contacts between consecutive frames: (certainty (n - 1, 2, 2) of each point of each foot, its steps
    (n - 1, 2, 2, 2) over the ground)."""
    points = frames.joints[:, self.feet]
    height = np.maximum((points[..., 1] - self.floor) / self.metre, 0)
    sure = frames.sure / (1 + (height / _LOW) ** 6)
    return np.minimum(sure[:-1], sure[1:]), np.diff(points[..., [0, 2]], axis=0)

  def reach(self, frames: _Frames, count: int) -> _Frames:
    body = frames.joints
    feet = body[:, self.feet]
    sunk = np.maximum(self.floor - feet[..., 1].min(2), 0)
    lift = _weighted(np.maximum(np.maximum(sunk[:-2], sunk[1:-1]), sunk[2:]), _NEAR)
    now = _cut(frames, 3, 3 + count)
    aims, caps, need = [], [], np.zeros(len(body))
    for side, (leg, lengths) in enumerate(zip(self.legs, self.lengths)):
      hip, ankle, reach = body[:, leg[0]], body[:, leg[2]], sum(lengths)
      aim = ankle + frames.move[:, side]
      cap = np.maximum(np.linalg.norm(ankle - hip, axis=-1), _REACH * reach)
      flat = np.linalg.norm((aim - hip)[:, [0, 2]], axis=-1)
      need = np.maximum(need, hip[:, 1] - aim[:, 1] - np.sqrt(np.maximum(cap ** 2 - flat ** 2, 0)))
      aims.append(aim[3:3 + count] + lift[:, side, None] * [0, 1, 0])
      caps.append(cap[3:3 + count])
    need = np.clip(need, 0, _LOWER * self.metre)
    need = _weighted(np.maximum(np.maximum(need[:-2], need[1:-1]), need[2:]), _NEAR)
    result = now.joints - need[:, None, None] * [0, 1, 0]
    for leg, lengths, aim, cap in zip(self.legs, self.lengths, aims, caps):
      self._bend(now.joints, result, leg, lengths, aim, cap)
    return now._replace(joints=result)

  def _bend(self, source: np.ndarray, result: np.ndarray, leg: Any, lengths: tuple[float, float], aim: np.ndarray,
            cap: np.ndarray) -> None:
    """Bends a leg of result towards aim (n, 3), at most cap (n,) long; the foot keeps its direction. In place."""
    hip, knee, ankle = leg[:3]
    upper, lower = lengths
    line = aim - result[:, hip]
    wanted = np.linalg.norm(line, axis=-1)
    was = np.linalg.norm(source[:, ankle] - source[:, hip], axis=-1)
    start = np.minimum(np.maximum(was, cap - _SOFT * (upper + lower)), cap - 1e-6)
    over = np.maximum(wanted - start, 0)
    distance = np.minimum(wanted, start) + (cap - start) * -np.expm1(-over / (cap - start))
    distance = np.clip(distance, 1.001 * abs(upper - lower), 0.99999 * (upper + lower))
    below = [result[:, joint] - result[:, ankle] for joint in leg[3:]]
    result[:, ankle] = result[:, hip] + line * (distance / np.maximum(wanted, 1e-9))[:, None]
    result[:, knee] = bend(result[:, hip], result[:, ankle], knee_side(source, leg, self.skeleton), upper, lower)
    for joint, offset in zip(leg[3:], below):
      result[:, joint] = result[:, ankle] + offset


class _Smooth:
  """Removes tremor, restores bone lengths, and prevents bones from flipping."""

  def __init__(self, body: _Body) -> None:
    self._body, self._steady = body, SteadyBones(body.skeleton)

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    joints = with_lengths(self._body.smooth(frames, count), self._body.skeleton)
    joints = self._steady(joints, frames.joints)
    joints[..., 1] += self._body.risen(frames)[:, None]
    return _cut(frames, 2, 2 + count)._replace(joints=joints)


class _Path:
  """Moves the whole body so that its standing feet do not slide on average."""

  def __init__(self, body: _Body) -> None:
    self._body, self._offset = body, np.zeros(2)

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    body = self._body
    sure, steps = body.stands(frames)
    speed = np.linalg.norm(steps, axis=-1) * body.fps / body.metre
    weight = sure / (0.05 + speed)  # of two feet the slower one stands
    slide = (weight[..., None] * steps).sum((1, 2)) / np.maximum(weight.sum((1, 2)), 1e-9)[:, None]
    # A low certainty is enough: the network is never certain about a foot that slides.
    hint = np.minimum(4 * sure.max((1, 2)), 1)
    # Of the steps to t - 2 .. t + 2. A body in flight keeps the speed with which it left the ground, so the stances on
    # either side determine its correction, too.
    slide = _weighted(slide * hint[:, None], _NEAR) / np.maximum(_weighted(hint, _NEAR), _HINT)[:, None]
    slide = slide[:count]
    fast = np.linalg.norm(slide, axis=-1, keepdims=True) * body.fps / body.metre
    back = -slide * np.maximum(1 - _SLIDES / np.maximum(fast, 1e-9), 0)
    now = _cut(frames, 3, 3 + count)
    moved = np.cumsum(np.concatenate([self._offset[None], back * now.labelled[:, None]]), axis=0)[1:]
    self._offset = moved[-1]
    joints = now.joints.copy()
    joints[..., [0, 2]] += moved[:, None]
    return now._replace(joints=joints)


class _PinFeet:
  """Computes how to move each foot over the ground so that it does not slide while it stands.

  The moves e of a frame and the next `ahead` frames minimize sum s |step of (foot + e)|^2 + ease |step of e|^2
  + bend |step of step of e|^2 + pull |e|^2, with the earlier moves fixed; then the first of them becomes final.
  """

  def __init__(self, body: _Body) -> None:
    self._body = body
    self._last = np.zeros((2, 2, 2))  # the move of each foot in the frame before, and in the one before that

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    body = self._body
    sure, steps = body.stands(frames)
    speed = np.linalg.norm(steps, axis=-1) * body.fps / body.metre
    labelled = frames.labelled[1:, None, None] > 0
    slow = 1 / (1 + (speed / np.where(labelled, _STANDS, _SEEN)) ** 4)
    firm = np.minimum(2 * sure, 1) * slow  # (n - 1, feet, points)
    total = firm.sum(-1)
    step = (firm[..., None] * steps).sum(2) / np.maximum(total, 1e-9)[..., None]
    size = len(frames.joints) - count  # moves that are solved for together
    windows = np.arange(count)[:, None] + np.arange(size)
    firm, step = total[windows].swapaxes(1, 2), step[windows].swapaxes(1, 2)  # (count, feet, size), (..., 2)
    # Steps D, and steps of steps C, of [e_-2, e_-1, e_0, e_1, ...].
    first = np.eye(size + 2)[1:-1] * -1 + np.eye(size + 2)[2:]
    second = np.eye(size + 2)[:-2] - 2 * np.eye(size + 2)[1:-1] + np.eye(size + 2)[2:]
    whole = np.einsum("ki,cfk,kj->cfij", first, firm + _EASE, first) + _BEND * second.T @ second
    matrix = whole[..., 2:, 2:] + _PULL * np.eye(size)
    pushed = -np.einsum("ki,cfk,cfkd->cfid", first[:, 2:], firm, step)
    solved = np.linalg.solve(matrix, np.concatenate([pushed, -whole[..., 2:, :2]], -1))[:, :, 0]  # (count, feet, 4)
    moves = np.empty((count, 2, 2))
    before, last = self._last
    for i in range(count):
      moves[i] = solved[i, :, :2] + solved[i, :, 2:3] * before + solved[i, :, 3:] * last
      before, last = last, moves[i]
    self._last = np.stack([before, last])
    now = _cut(frames, 1, 1 + count)
    move = np.zeros((count, 2, 3))
    move[..., [0, 2]] = moves
    return now._replace(move=move)
