"""Foot-skate cleanup of generated joints: feet that stand still while they stand, legs that do not snap, no tremor.

A network's joints are right to a few millimetres, frame by frame; the eye sees what is left as sliding feet and tremor.
What it makes of a whole step, the path of the body over the ground, need not fit what the legs do. In four stages:

1. tremor goes, where a joint is slow: a punch keeps its speed; bones get their lengths, and limbs do not flip
   (`steady_bones`);
2. a body whose standing feet slide moves as its feet say, where the network says which stand;
3. a foot stands still while it stands, and eases back to where it was in the air;
4. legs that do not reach their feet lower the hips, and never get straighter than 0.995 of their length or than they
   were: the nearer a knee is to straight, the farther a centimetre of the foot turns it.

Each frame is decided when the `LOOK_AHEAD` frames behind it are known, in a clip as in a stream. numpy, float64.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Num

from motion_jax.motion.retarget import bend, floor_height, knee_side, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.steady_bones import SteadyBones
from motion_jax.shapes import Array

_SIGMA = 0.7             # frames: 2 Hz passes at 0.9, the tremor of frame against frame at 0.1
_BRISK = (1.2, 2.4)      # m/s against the pelvis: from here a joint is smoothed less, from there not at all
_SLIDES = 0.10           # m/s of standing feet that real motion shows, too
_NEAR = np.array([1, 2, 3, 2, 1]) / 9  # weights of a frame's neighbours where something is spread in time
_HINT = 0.15             # how sure of what stands nearby a path must be to go by it altogether
_STANDS = 0.40           # m/s at which a foot that is said to stand is half as sure to
_UNTOLD = 0.20           # the same where nobody says which feet stand: one that swings must not be held
_LOW = 0.16              # metres over the floor at which a point of it is half as sure to
_EASE, _BEND, _PULL = 0.02, 0.05, 4e-3  # how a foot's correction resists change, change of its change, and being there
_REACH, _SOFT = 0.995, 0.03  # of a leg's length: how straight it may be made, and the zone before
_LOWER = 0.08            # metres that the hips come down at the most
_AHEAD = (2, 2, 3, 3)    # frames that each stage looks ahead
LOOK_AHEAD = sum(_AHEAD)


def clean_up(joints: Num[Array, "t j 3"], contacts: Num[Array, "t 4"] | None = None, skeleton: Skeleton = HUMANML3D,
             fps: float | None = None) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) with planted feet, canonical bone lengths and no tremor, float32 of the same shape.

  contacts (T, 4): how surely ankle and toes stand, left then right, 0..1 (the contact columns of full features), over a
  floor at y = 0; without them slow and low feet are taken to stand, over the floor where feet are lowest. fps: None is
  the skeleton's. The same as a `Cleaner` that gets the motion in pieces.
  """
  joints = np.asarray(joints)
  if len(joints) < 3:
    return joints.astype(np.float32)
  floor = float(floor_height(joints, skeleton)) if contacts is None else 0.0
  cleaner = Cleaner(skeleton, fps, floor)
  return np.concatenate([cleaner.push(joints, contacts), cleaner.flush()])


class Cleaner:
  """Cleans a motion that is still being made: pieces in, cleaned frames out, `LOOK_AHEAD` frames later.

    cleaner = Cleaner()
    for joints, contacts in pieces:
      show(cleaner.push(joints, contacts))   # frames (n, J, 3), at first fewer than came in
    show(cleaner.flush())                    # the last of them

  Neither time nor memory of a piece grows with the motion.
  """

  def __init__(self, skeleton: Skeleton = HUMANML3D, fps: float | None = None, floor: float = 0.0) -> None:
    """floor: its height, in the skeleton's unit."""
    body = _Body(skeleton, fps or skeleton.fps, floor)
    smooth, path, pin, reach = _AHEAD
    self._stages = [_Stage(_Smooth(body), 2, smooth), _Stage(_Path(body), 3, path), _Stage(_PinFeet(body), 1, pin),
                    _Stage(body.reach, 3, reach)]

  def push(self, joints: Num[Array, "n j 3"], contacts: Num[Array, "n 4"] | None = None) -> Float[np.ndarray, "m j 3"]:
    """The frames (m, J, 3), float32, that are decided once these joints (n, J, 3) are known."""
    count = len(joints)
    sure = np.ones((count, 2, 2))
    if contacts is not None:
      sure = np.clip((np.asarray(contacts, np.float64).reshape(-1, 2, 2) - 0.3) / 0.4, 0, 1)
    told = np.full(count, float(contacts is not None))
    frames = _Frames(np.asarray(joints, np.float64), sure, told, np.zeros((count, 2, 3)))
    for stage in self._stages:
      frames = stage.push(frames)
    return frames.joints.astype(np.float32)

  def flush(self) -> Float[np.ndarray, "m j 3"]:
    """The frames that wait for what comes behind them, as if the motion ended here; for the end of a motion."""
    rest: _Frames | None = None
    for stage in self._stages:
      rest = stage.flush(rest)
    assert rest is not None
    return rest.joints.astype(np.float32)


def solve_legs(joints: Num[Array, "t j 3"], move: Num[Array, "t 2 3"], skeleton: Skeleton = HUMANML3D
            ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) with the left and right foot moved by move (T, 2, 3), the legs bent to reach them: the last stage
  of the cleanup, for a whole motion whose feet somebody else places. float64."""
  body, count = _Body(skeleton, skeleton.fps, -np.inf), len(joints)  # no floor: no foot is lifted onto it
  frames = _Frames(np.asarray(joints, np.float64), np.zeros((count, 2, 2)), np.zeros(count), np.asarray(move))
  return body.reach(_join(_repeat(frames, 0, 3), frames, _repeat(frames, -1, 3)), count).joints


class _Frames(NamedTuple):
  """What stages hand on of n frames; feet are left and right, points of a foot ankle and toes."""
  joints: np.ndarray  # (n, J, 3)
  sure: np.ndarray    # (n, 2, 2) how surely each point of each foot stands
  told: np.ndarray    # (n,) 1 where that was told, 0 where it is to be seen from the motion
  move: np.ndarray    # (n, 2, 3) where each foot is to be, less where it is


class _Stage:
  """A function of windows of frames as one of a stream: it decides a frame when `ahead` more are known.

  function(n + back + ahead frames) -> the n frames after the first `back`. The first frame is repeated before the
  motion, the last one behind it.
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
    """frames: the last that come in -> all that had not gone out."""
    made = None if frames is None else self.push(frames)
    if self._held is None:
      return made
    last = self.push(_repeat(self._held, -1, self._ahead)) if self._ahead else None
    return _join(*(part for part in (made, last) if part is not None))


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
  """A skeleton's feet and legs, left then right, and the stages that only look at neighbours."""

  def __init__(self, skeleton: Skeleton, fps: float, floor: float) -> None:
    self.skeleton, self.fps, self.floor = skeleton, fps, floor
    self.metre = 1 / skeleton.unit
    self.feet = np.array([skeleton.left_feet, skeleton.right_feet])
    legs = [chain[1:] for chain in skeleton.chains[:2]]  # without the root
    self.legs = sorted(legs, key=lambda leg: leg[-1] != skeleton.left_feet[-1])
    self.lengths = [(skeleton.bone_lengths[leg[1]], skeleton.bone_lengths[leg[2]]) for leg in self.legs]

  def smooth(self, frames: _Frames, count: int) -> np.ndarray:
    """Joints (count, J, 3) without tremor."""
    weights = np.exp(-0.5 * (np.arange(-2, 3) / _SIGMA) ** 2)
    smoothed = _weighted(frames.joints, weights / weights.sum())
    about = frames.joints - frames.joints[:, :1]
    # Over four frames, in which tremor does not get far.
    speed = np.linalg.norm(about[4:] - about[:-4], axis=-1) / 4 * self.fps / self.metre
    brisk = np.clip((speed - _BRISK[0]) / (_BRISK[1] - _BRISK[0]), 0, 1)[..., None]
    now = _cut(frames, 2, 2 + count)
    return smoothed + (now.joints - smoothed) * brisk * brisk * (3 - 2 * brisk)

  def risen(self, frames: _Frames) -> np.ndarray:
    """How far (count,) a body rises or sinks as its bones get their lengths."""
    # Bones of their own length from the pelvis down put the feet elsewhere. How high these are says more of where the
    # floor is than how high the pelvis is: it rises or sinks, and knees stay as bent as they were.
    lowest = lambda joints: joints[:, self.feet, 1].min((1, 2))
    risen = lowest(frames.joints) - lowest(with_lengths(frames.joints, self.skeleton))
    return _weighted(risen, _NEAR)

  def stands(self, frames: _Frames) -> tuple[np.ndarray, np.ndarray]:
    """(how surely (n - 1, 2, 2) the points of feet may stand from each frame to the next, their steps (n - 1, 2, 2, 2)
    over the ground)."""
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
    """Bends a leg of result towards aim (n, 3), as far as cap (n,) lets it reach; the foot keeps its turn. In place."""
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
  """Takes tremor away, and gives bones their lengths and directions that do not flip."""

  def __init__(self, body: _Body) -> None:
    self._body, self._steady = body, SteadyBones(body.skeleton)

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    joints = with_lengths(self._body.smooth(frames, count), self._body.skeleton)
    joints = self._steady(joints, frames.joints)
    joints[..., 1] += self._body.risen(frames)[:, None]
    return _cut(frames, 2, 2 + count)._replace(joints=joints)


class _Path:
  """Moves the whole body so that its standing feet, taken together, do not slide."""

  def __init__(self, body: _Body) -> None:
    self._body, self._offset = body, np.zeros(2)

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    body = self._body
    sure, steps = body.stands(frames)
    speed = np.linalg.norm(steps, axis=-1) * body.fps / body.metre
    weight = sure / (0.05 + speed)  # of two feet the slower one is the one that stands
    slide = (weight[..., None] * steps).sum((1, 2)) / np.maximum(weight.sum((1, 2)), 1e-9)[:, None]
    # A hint that one stands is enough, for of a foot that slides the network is never sure.
    hint = np.minimum(4 * sure.max((1, 2)), 1)
    # Of steps that lead to t - 2 .. t + 2. A body in flight keeps the speed with which it left the ground: what stances
    # on either side say holds there, too.
    slide = _weighted(slide * hint[:, None], _NEAR) / np.maximum(_weighted(hint, _NEAR), _HINT)[:, None]
    slide = slide[:count]
    fast = np.linalg.norm(slide, axis=-1, keepdims=True) * body.fps / body.metre
    back = -slide * np.maximum(1 - _SLIDES / np.maximum(fast, 1e-9), 0)
    now = _cut(frames, 3, 3 + count)
    moved = np.cumsum(np.concatenate([self._offset[None], back * now.told[:, None]]), axis=0)[1:]
    self._offset = moved[-1]
    joints = now.joints.copy()
    joints[..., [0, 2]] += moved[:, None]
    return now._replace(joints=joints)


class _PinFeet:
  """Says how to move each foot over the ground so that it keeps still while it stands.

  The moves e of a frame and the `ahead` next solve min sum s |step of (foot + e)|^2 + ease |step of e|^2
  + bend |step of step of e|^2 + pull |e|^2 behind the moves that are decided; the first of them is then decided.
  """

  def __init__(self, body: _Body) -> None:
    self._body = body
    self._last = np.zeros((2, 2, 2))  # the move of each foot in the frame before, and in the one before that

  def __call__(self, frames: _Frames, count: int) -> _Frames:
    body = self._body
    sure, steps = body.stands(frames)
    speed = np.linalg.norm(steps, axis=-1) * body.fps / body.metre
    told = frames.told[1:, None, None] > 0
    slow = 1 / (1 + (speed / np.where(told, _STANDS, _UNTOLD)) ** 4)
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
    made = np.empty((count, 2, 2))
    before, last = self._last
    for i in range(count):
      made[i] = solved[i, :, :2] + solved[i, :, 2:3] * before + solved[i, :, 3:] * last
      before, last = last, made[i]
    self._last = np.stack([before, last])
    now = _cut(frames, 1, 1 + count)
    move = np.zeros((count, 2, 3))
    move[..., [0, 2]] = made
    return now._replace(move=move)
