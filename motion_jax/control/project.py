"""Project a motion onto its constraints: targets are met exactly, by a small change that is smooth in time.

Three stages. If the pelvis is far off its path, or faces elsewhere, each step is turned and moved there as a whole
(`motion.root_paths`). The motion is blended into whole-body poses (`control.poses`). The remaining error is solved for
all frames at once: rotations of joints and shifts of the body e,

  min  hard |targets - positions|^2  +  stand |standing feet - their stance|^2
       +  |S (e_(t+1) - 2 e_t + e_(t-1))|^2  +  pull |S e|^2

by Gauss-Newton; S is the stiffness of each parameter (`STIFF`). Bone lengths are those of the motion, or of the given
whole-body poses. numpy, float64.
"""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax.control import poses
from motion_jax.control.compiling import angle_of, clip_to_feasible, compile, warn_missed
from motion_jax.control.constraints import Constraint
from motion_jax.control.keys import without_slack
from motion_jax.control.signal import ControlSignal
from motion_jax.motion import rotations as rot
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.root_paths import along
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import gaussian_along_path, gaussian_filter1d
from motion_jax.shapes import Bool, Float, Num
from motion_jax.utils.errors import InputError

_FAR, _TURNED = 0.12, 0.35  # metres, radians: a larger error moves the whole path
_ARM = 0.75                 # metres over the ground from the pelvis within which hands and feet reach
_HARD, _STAND, _FACE = 1e5, 30.0, 300.0  # weights of targets, standing feet, and headings and hinges
_LASTS = 1.0                # seconds: time scale of a change of course
_COURSE = 0.35              # seconds, sigma of the Gaussian that removes the sway of steps from a path
_STEP = 0.4                 # radians and metres: largest change in one iteration
_STRAIGHT = 0.02            # radians: least angle of elbows and knees
_DAMPED = 100.0             # damping after an iteration that increased the error
_LEAST, _ROUNDS = 3, 50     # least and largest number of iterations
_NEAR = 4e-4                # metres: tolerance
_HINGE = 0.1                # sine of the angle below which a limb alone does not define its hinge
LONGEST = 2400              # frames


def check_length(count: int) -> None:
  """Raises InputError for a motion too long for projection."""
  if count > LONGEST:
    raise InputError(f"got {count:,} frames with constraints, expected at most {LONGEST:,}; generate the motion in "
                     "parts, or without projection (--no-cleanup)")


def project(joints: Num[np.ndarray, "t 22 3"], constraints: ControlSignal | Sequence[Constraint], fps: float = 20.0,
            warn: bool = True) -> Float[np.ndarray, "t 22 3"]:
  """Changes joints (T, 22, 3), metres, to meet the constraints within a millimetre where this is feasible. float32.

  constraints: a signal (1, T) in the frame of the joints, or constraints, of which paths, poses and targets are used.
  Without targets the joints are returned unchanged. warn: warn about infeasible targets, with the worst frame.
  Raises InputError for more than two minutes at 20 frames a second.
  """
  count, start = len(joints), np.asarray(joints, np.float64)
  if not isinstance(constraints, ControlSignal):
    constraints = without_slack(constraints, start, fps)
  wanted = _wanted(constraints, count, fps, warn)
  signal = wanted(start, warn)
  if signal.is_empty:
    return np.asarray(joints, np.float32)
  check_length(count)
  lengths = poses.lengths_from_poses(signal)
  start = poses.with_build(start, lengths)
  silent = lambda now: wanted(now, False)
  carried = _carried(start, silent(start), fps)
  moved = _solved(_posed(carried, silent, lengths, fps), carried, silent, fps)
  if warn:
    signal = wanted(moved, False)
    off = np.where(np.asarray(signal.given)[0], moved - np.asarray(signal.positions, np.float64)[0], 0)
    warn_missed(signal, np.linalg.norm(off, axis=-1), fps)
  return moved.astype(np.float32)


def _wanted(constraints: Any, count: int, fps: float, warn: bool) -> Callable[[np.ndarray, bool], ControlSignal]:
  """Function of (joints so far, warn) to the signal (1, T): positions of poses and targets may depend on the motion."""
  if isinstance(constraints, ControlSignal):
    if constraints.batch != 1 or constraints.frames != count:
      raise ValueError(f"got a signal of {constraints.batch} motions of {constraints.frames} frames for one of {count}")
    known = clip_to_feasible(constraints, fps, warn)
    return lambda joints, warn: known
  return lambda joints, warn: clip_to_feasible(compile(constraints, count, fps, joints), fps, warn)


def spread(values: Float[np.ndarray, "t k"], given: Bool[np.ndarray, " t"], fps: float, lasting: bool
           ) -> Float[np.ndarray, "t k"]:
  """Interpolates values (T, K) smoothly from the given frames (T,) to all; elsewhere they fade to 0 within about half a
  second, or stay constant if lasting. Zero if none are given."""
  if not given.any():
    return np.zeros_like(values)
  matrix = poses.second_differences(len(values))
  matrix[0] += 1e-10 if lasting else (poses.FADES * fps) ** -4.0
  if lasting:
    steps = (_LASTS * fps) ** -2.0
    matrix[0, :-1] += steps
    matrix[0, 1:] += steps
    matrix[1, :-1] -= steps
  return poses.solve_banded(matrix, np.zeros_like(values), values, given)


def _posed(joints: np.ndarray, wanted: Callable[[np.ndarray], ControlSignal], lengths: np.ndarray | None, fps: float
           ) -> np.ndarray:
  """The motion blended into the whole-body poses, if these show one body."""
  signal = wanted(joints)
  if lengths is None:
    return joints
  return poses.meet_poses(joints, np.asarray(signal.positions, np.float64)[0],
                          np.asarray(signal.given)[0].all((-1, -2)), lengths, fps)


def _carried(joints: np.ndarray, signal: ControlSignal, fps: float) -> np.ndarray:
  """The motion with its path and headings moved near the targets; each step moves as a whole."""
  places, given = np.asarray(signal.positions, np.float64)[0], np.asarray(signal.given)[0]
  ground = [0, 2]
  aim, targeted = joints[:, 0, ground].copy(), given[:, 0, ground].all(-1)
  aim[targeted] = places[targeted, 0][:, ground]
  # A hand or foot target out of reach moves the body.
  for frame in np.flatnonzero(~targeted & given[..., ground].all(-1).any(-1)):
    far = places[frame][given[frame, :, ground].all(0)][:, ground] - aim[frame]
    size = np.linalg.norm(far, axis=-1)
    if size.max() > _ARM:
      aim[frame] += far[size.argmax()] * (1 - _ARM / size.max())
      targeted[frame] = True
  away = aim - joints[:, 0, ground]
  facing, faced = np.array(signal.heading, np.float64)[0], np.array(signal.heading_given)[0]
  whole = given.all((-1, -2)) & ~faced
  facing[whole], faced[whole] = angle_of(places[whole]) if whole.any() else 0, True
  wrap = lambda angle: (angle + np.pi) % (2 * np.pi) - np.pi
  headings = angle_of(joints)
  near = not targeted.any() or np.linalg.norm(away[targeted], axis=-1).max() < _FAR
  if near and (not faced.any() or np.abs(wrap(facing - headings)[faced]).max() < _TURNED):
    return joints
  pad = int(4 * _COURSE * fps)
  course = lambda points: gaussian_along_path(points, _COURSE * fps, pad, span=pad)
  path = course(joints[:, 0, ground])
  goal = course(joints[:, 0, ground] + spread(away, targeted, fps, lasting=True))
  turn = np.zeros(len(joints))
  if targeted.sum() > 1 and not near:
    # The angle between the two courses, weighted by speed.
    (x, z), (u, v) = (np.gradient(way, axis=0).T * fps for way in (path, goal))
    weigh = lambda a: gaussian_filter1d(a, _COURSE * fps, mode="nearest")
    along_, across = weigh(x * u + z * v) + 1e-3, weigh(u * z - x * v)
    turn = np.unwrap(np.arctan2(across, along_))
  if faced.any():
    rest = np.unwrap(wrap(facing - headings - turn)[faced])
    filled = np.zeros((len(turn), 1))
    filled[faced, 0] = rest
    turn = turn + spread(filled, faced, fps, lasting=True)[:, 0]
  return along(joints, turn, path, goal, HUMANML3D, fps)



def _stances(joints: np.ndarray, signal: ControlSignal, fps: float) -> tuple[np.ndarray, np.ndarray]:
  """(target positions of ankles and toes (T, 4, 3), whether they stand (T, 4)), joints 7, 10, 8, 11.

  A stance in which the foot has a target moves there as a whole.
  """
  feet = list(HUMANML3D.left_feet + HUMANML3D.right_feet)
  places, given = np.asarray(signal.positions, np.float64)[0], np.asarray(signal.given)[0]
  where, stand = joints[:, feet].copy(), np.repeat(stands(joints, fps), 2, axis=1)
  for side in (0, 2):
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stand[:, side], [False]]).astype(int)))
    for first, past in zip(edges[::2], edges[1::2]):
      frames = slice(first, past)
      points = feet[side:side + 2]
      targeted = given[frames][:, points]
      off = np.where(targeted, places[frames][:, points] - joints[frames][:, points], 0)
      where[frames, side:side + 2] += off.sum((0, 1)) / np.maximum(targeted.sum((0, 1)), 1)
  return where, stand


def _solved(joints: np.ndarray, carried: np.ndarray, wanted: Callable[[np.ndarray], ControlSignal], fps: float
            ) -> np.ndarray:
  """Minimizes the objective of this file for all frames at once; stances are those of the carried motion."""
  from scipy.linalg import solveh_banded
  count, size = len(joints), SIZE
  feet = list(HUMANML3D.left_feet + HUMANML3D.right_feet)
  weights = STIFF ** 2
  smooth = poses.second_differences(count)
  smooth[0] += (poses.FADES * fps) ** -4.0
  rows, columns = np.tril_indices(size)
  done, now = np.zeros((count, size)), joints
  where, stand = _stances(carried, wanted(joints), fps)
  axes = hinges(joints)
  least = {number: np.minimum(angle, _STRAIGHT) for number, angle in bends(joints, axes).items()}
  lowest = np.minimum(joints[:, feet, 1], 0.0)
  damping, before, best = 0.0, np.inf, (np.inf, now)
  for round_ in range(_ROUNDS):
    signal = wanted(now)
    given = np.asarray(signal.given)[0]
    off = np.where(given, np.asarray(signal.positions, np.float64)[0] - now, 0)
    worst = np.abs(off).max()
    if worst < _NEAR and round_ >= _LEAST:  # a path alone converges in one iteration; standing feet need more
      return now
    best = min(best, (worst, now), key=lambda candidate: candidate[0])
    # Near a straight limb a step overshoots: Levenberg-Marquardt damping.
    damping, before = max(4 * damping, _DAMPED) if worst > max(before, _NEAR) else damping / 2, worst
    slope = slopes(now, axes)
    pushed, square = np.zeros((count, size)), np.zeros((count, size, size))
    sunk = (now[:, feet, 1] < lowest)[..., None]  # under the floor
    for at, gap, weight in ((slope, off, _HARD * given),
                            (slope[:, feet], where - now[:, feet], _STAND * np.repeat(stand[..., None], 3, -1)),
                            (slope[:, feet, 1:2], (lowest - now[:, feet, 1])[..., None], _STAND * sunk)):
      used = weight.any((0, 2))
      at, gap, weight = (x[:, used] for x in (at, gap, weight))
      flat = (at * weight[..., None]).reshape(count, -1, size)
      pushed += np.einsum("trp,tr->tp", flat, gap.reshape(count, -1))
      square += np.matmul(flat.swapaxes(1, 2), at.reshape(count, -1, size))
    _add_headings(pushed, square, signal, now)
    for number, angle in bends(now, axes).items():  # keep elbows and knees from bending the wrong way
      start, gap = STARTS[number], np.maximum(least[number] - angle, 0)
      pushed[:, start] += _FACE * gap
      square[:, start, start] += _FACE * (gap > 0)
    # Bands of all frames' parameters, lower form: within a frame from the squares, between frames from smoothness.
    matrix = np.zeros((2 * size + 1, count, size))
    matrix[rows - columns, :, columns] = square[:, rows, columns].T
    matrix[0] += damping
    for apart in range(3):
      matrix[apart * size] += smooth[apart][:, None] * weights
    pushed -= poses.multiply_banded(smooth, done) * weights
    change = solveh_banded(matrix.reshape(2 * size + 1, -1), pushed.reshape(-1), lower=True).reshape(count, size)
    change *= min(1.0, _STEP / max(np.abs(change).max(), 1e-9))
    done = done + change
    now, axes = bent(now, change, axes)
    if np.abs(change).max() < 1e-4:
      break
  off = np.where(given, np.asarray(signal.positions, np.float64)[0] - now, 0)
  return now if np.abs(off).max() < best[0] else best[1]


def _add_headings(pushed, square, signal, joints):
  """Adds the headings of a signal to the equations of a step."""
  faced = np.asarray(signal.heading_given)[0]
  if faced.any():
    turn = STARTS[0] + 1
    gap = (np.asarray(signal.heading, np.float64)[0] - angle_of(joints) + np.pi) % (2 * np.pi) - np.pi
    pushed[:, turn] += _FACE * faced * gap
    square[:, turn, turn] += _FACE * faced


# --- parameters of a body: turns about joints, which preserve bone lengths --------------------------------------------


class Turn(NamedTuple):
  """A rotation of some joints about a pivot; stiff: stiffness relative to the shoulder's."""
  pivot: int
  moved: np.ndarray  # (22,) whether each joint moves
  stiff: float
  hinge: bool = False  # about one axis, as knees and elbows



def _turn(pivot: int, joints: list[int], stiff: float, hinge: bool = False) -> Turn:
  moved = np.zeros(HUMANML3D.num_joints, bool)
  for joint in joints:
    moved[[joint, *HUMANML3D.descendants(joint)]] = True
  return Turn(pivot, moved, stiff, hinge)


# From the pelvis outwards. Hips, collars and the root of the neck are stiff: they turn only to fit another build.
TURNS = (
    _turn(0, [1, 2, 3], 3.0), _turn(0, [1], 12.0), _turn(0, [2], 12.0), _turn(0, [3], 3.0),
    _turn(3, [6], 2.5), _turn(6, [9], 2.5), _turn(9, [12, 13, 14], 2.5), _turn(9, [12], 8.0), _turn(9, [13], 8.0),
    _turn(9, [14], 8.0), _turn(12, [15], 1.0), _turn(13, [16], 4.0), _turn(14, [17], 4.0), _turn(16, [18], 1.0),
    _turn(17, [19], 1.0), _turn(18, [20], 1.0, True), _turn(19, [21], 1.0, True), _turn(1, [4], 1.0),
    _turn(2, [5], 1.0), _turn(4, [7], 1.0, True), _turn(5, [8], 1.0, True), _turn(7, [10], 1.0), _turn(8, [11], 1.0))
_ROOT = 4.0  # stiffness of moving the whole body by a metre, relative to turning a shoulder by a radian

WIDTHS = np.array([1 if turn.hinge else 3 for turn in TURNS])
STARTS = 3 + np.append(0, np.cumsum(WIDTHS))[:-1]  # after the three that move the whole body
SIZE = int(3 + WIDTHS.sum())
STIFF = np.concatenate([np.full(3, _ROOT), *(np.full(width, turn.stiff) for turn, width in zip(TURNS, WIDTHS))])


def hinges(joints: Float[np.ndarray, "t 22 3"]) -> dict[int, np.ndarray]:
  """Hinge axes {number of the turn: (T, 3)} of elbows and knees: perpendicular to the limb's bones, smooth in time."""
  across = rot.unit(joints[:, 1] - joints[:, 2], 1e-9)
  axes = {}
  for number, turn in enumerate(TURNS):
    if not turn.hinge:
      continue
    end = HUMANML3D.parents.index(turn.pivot)
    upper = rot.unit(joints[:, turn.pivot] - joints[:, HUMANML3D.parents[turn.pivot]], 1e-9)
    lower = rot.unit(joints[:, end] - joints[:, turn.pivot], 1e-9)
    # A straight knee's axis is the line through the hips; a straight elbow's follows from the facing direction.
    usual = across if turn.pivot in (4, 5) else np.cross(upper, np.cross(across, [0.0, 1.0, 0.0]))
    axis = gaussian_filter1d(np.cross(upper, lower) + _HINGE * usual, 2.0, axis=0, mode="nearest")
    axis = axis - lower * (axis * lower).sum(-1, keepdims=True)
    axes[number] = rot.unit(axis, 1e-9)
  return axes


def slopes(joints: Float[np.ndarray, "t 22 3"], axes: dict[int, np.ndarray]) -> Float[np.ndarray, "t 22 3 p"]:
  """Jacobian of joint positions by the body's P parameters: a shift of the whole body, then turns, radians."""
  result = np.zeros((*joints.shape, SIZE))
  result[..., :3] = np.eye(3)
  for number, (turn, start) in enumerate(zip(TURNS, STARTS)):
    arm = joints[:, turn.moved] - joints[:, turn.pivot, None]  # (T, n, 3)
    if turn.hinge:
      result[..., start][:, turn.moved] = np.cross(axes[number][:, None], arm)
    else:
      x, y, z = np.moveaxis(arm, -1, 0)
      zero = np.zeros_like(x)
      rows = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], -1).reshape(*x.shape, 3, 3)
      result[..., start:start + 3][:, turn.moved] = rows
  return result


def bends(joints: Float[np.ndarray, "t 22 3"], axes: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
  """Angles {number of the turn: (T,)} of elbows and knees; negative if bent the wrong way."""
  angles = {}
  for number, axis in axes.items():
    pivot = TURNS[number].pivot
    upper = joints[:, pivot] - joints[:, HUMANML3D.parents[pivot]]
    lower = joints[:, HUMANML3D.parents.index(pivot)] - joints[:, pivot]
    angles[number] = np.arctan2((np.cross(upper, lower) * axis).sum(-1), (upper * lower).sum(-1))
  return angles


def bent(joints: Float[np.ndarray, "t 22 3"], change: Float[np.ndarray, "t p"], axes: dict[int, np.ndarray]
         ) -> tuple[Float[np.ndarray, "t 22 3"], dict[int, np.ndarray]]:
  """(joints (T, 22, 3) after a change (T, P) of the parameters, their hinge axes); bone lengths stay."""
  result = joints + change[:, None, :3]
  axes = dict(axes)
  for number, (turn, start) in enumerate(zip(TURNS, STARTS)):
    vector = axes[number] * change[:, start:start + 1] if turn.hinge else change[:, start:start + 3]
    about = rot.from_vector(vector)
    arm = result[:, turn.moved] - result[:, turn.pivot, None]
    result[:, turn.moved] = result[:, turn.pivot, None] + rot.rotate(about[:, None], arm)
    for other, axis in axes.items():  # a hinge axis turns with its limb
      if other > number and turn.moved[TURNS[other].pivot] and TURNS[other].pivot != turn.pivot:
        axes[other] = rot.rotate(about, axis)
  return result, axes
