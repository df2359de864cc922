"""Project a motion onto its constraints: targets are met exactly, by a change that is smooth in time and small.

Three stages. Where the pelvis is far off its path, or faces elsewhere, the body is carried there step by step, each
step turned and moved as a whole (`motion.root_paths`). It is blended into whole poses (`control.poses`). What is left
is solved for all frames at once: rotations of joints and shifts of the body e,

  min  hard |targets - positions|^2  +  stand |standing feet - their stance|^2
       +  |S (e_(t+1) - 2 e_t + e_(t-1))|^2  +  pull |S e|^2

by Gauss-Newton; S is the stiffness of each parameter (`STIFF`). Bone lengths are those of the motion, or of
the body in the whole poses that are given. numpy, float64.
"""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax.control import poses
from motion_jax.control.compiling import angle_of, clip_to_feasible, compile, warn_missed
from motion_jax.control.constraints import Constraint
from motion_jax.control.signal import ControlSignal
from motion_jax.motion import rotations as rot
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.root_paths import along
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Bool, Float, Num
from motion_jax.utils.errors import InputError

_FAR, _TURNED = 0.12, 0.35  # metres, radians off, from which the body is carried step by step
_ARM = 0.75                 # metres over the ground from the pelvis within which a hand or a foot is reached
_HARD, _STAND, _FACE = 1e5, 30.0, 300.0
_LASTS = 1.0                # seconds over which a change of course comes
_COURSE = 0.35              # seconds, sigma of what is smoothed away of a path to have its direction
_STEP = 0.4                 # radians and metres of a change in one round
_STRAIGHT = 0.02            # radians: an elbow or a knee is not made straighter, nor bent the wrong way
_DAMPED = 100.0             # what resists a step after one that went too far
_LEAST, _ROUNDS = 3, 50     # rounds at least, and at the most
_NEAR = 4e-4                # metres off that are near enough
_HINGE = 0.1                # of a right angle: a limb that is bent less does not say alone where its hinge is
LONGEST = 2400              # frames


def check_length(count: int) -> None:
  """Raises InputError for a motion that is too long to be projected at once."""
  if count > LONGEST:
    raise InputError(f"got {count:,} frames with constraints, expected at most {LONGEST:,}; generate the motion in "
                     "parts, or without projection (--no-cleanup)")


def project(joints: Num[np.ndarray, "t 22 3"], constraints: ControlSignal | Sequence[Constraint], fps: float = 20.0,
            warn: bool = True) -> Float[np.ndarray, "t 22 3"]:
  """Joints (T, 22, 3), metres, that meet the constraints to within a millimetre where a body can, float32.

  constraints: a signal (1, T) in the frame of the joints, or constraints, of which paths, poses and targets count.
  Without any target the joints are returned unchanged. warn: warnings name the worst frame of infeasible targets.
  Raises InputError for more than two minutes at 20 frames a second.
  """
  count, start = len(joints), np.asarray(joints, np.float64)
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
  """signal (1, T) of the constraints for a motion so far: the place of poses and targets may depend on it."""
  if isinstance(constraints, ControlSignal):
    if constraints.batch != 1 or constraints.frames != count:
      raise ValueError(f"got a signal of {constraints.batch} motions of {constraints.frames} frames for one of {count}")
    known = clip_to_feasible(constraints, fps, warn)
    return lambda joints, warn: known
  return lambda joints, warn: clip_to_feasible(compile(constraints, count, fps, joints), fps, warn)


def spread(values: Float[np.ndarray, "t k"], given: Bool[np.ndarray, " t"], fps: float, lasting: bool
           ) -> Float[np.ndarray, "t k"]:
  """Values (T, K) for all frames from those of given (T,): smooth, and away from them fading within half a second, or,
  lasting, staying what they are. Zero where none are given."""
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
  """The motion blended into the whole poses, where those are of one body."""
  signal = wanted(joints)
  if lengths is None:
    return joints
  return poses.meet_poses(joints, np.asarray(signal.positions, np.float64)[0],
                          np.asarray(signal.given)[0].all((-1, -2)), lengths, fps)


def _carried(joints: np.ndarray, signal: ControlSignal, fps: float) -> np.ndarray:
  """The motion with its body carried near its targets, and turned, step by step."""
  places, given = np.asarray(signal.positions, np.float64)[0], np.asarray(signal.given)[0]
  ground = [0, 2]
  aim, targeted = joints[:, 0, ground].copy(), given[:, 0, ground].all(-1)
  aim[targeted] = places[targeted, 0][:, ground]
  # A hand or foot target out of reach takes the body there.
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
  own = angle_of(joints)
  near = not targeted.any() or np.linalg.norm(away[targeted], axis=-1).max() < _FAR
  if near and (not faced.any() or np.abs(wrap(facing - own)[faced]).max() < _TURNED):
    return joints
  course = lambda points: _smoothed(points, _COURSE * fps)
  path = course(joints[:, 0, ground])
  goal = course(joints[:, 0, ground] + spread(away, targeted, fps, lasting=True))
  turn = np.zeros(len(joints))
  if targeted.sum() > 1 and not near:
    # The direction from here to there of the two courses, of fast frames more than of slow ones.
    (x, z), (u, v) = (np.gradient(way, axis=0).T * fps for way in (path, goal))
    weigh = lambda a: gaussian_filter1d(a, _COURSE * fps, mode="nearest")
    along_, across = weigh(x * u + z * v) + 1e-3, weigh(u * z - x * v)
    turn = np.unwrap(np.arctan2(across, along_))
  if faced.any():
    rest = np.unwrap(wrap(facing - own - turn)[faced])
    filled = np.zeros((len(turn), 1))
    filled[faced, 0] = rest
    turn = turn + spread(filled, faced, fps, lasting=True)[:, 0]
  return along(joints, turn, path, goal, HUMANML3D, fps)


def _smoothed(points: np.ndarray, sigma: float) -> np.ndarray:
  """Points (T, K) by a Gaussian of sigma frames that continues straight beyond the ends."""
  pad = int(4 * sigma)
  beside = min(pad, len(points) - 1)
  far = np.arange(1, pad + 1)[:, None] / max(beside, 1)
  long = np.concatenate([points[0] + far[::-1] * (points[0] - points[beside]), points,
                         points[-1] + far * (points[-1] - points[-1 - beside])])
  return gaussian_filter1d(long, sigma, axis=0)[pad:len(long) - pad]


def _stances(joints: np.ndarray, signal: ControlSignal, fps: float) -> tuple[np.ndarray, np.ndarray]:
  """(where ankles and toes of standing feet are to be (T, 4, 3), whether they stand (T, 4)), joints 7, 10, 8, 11.

  A stance in which a foot has a target moves there as a whole.
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
  """Solves the formula above for all frames at once; feet stand where they stand in the carried motion."""
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
    if worst < _NEAR and round_ >= _LEAST:  # a path alone is met in one; standing feet take more
      return now
    best = min(best, (worst, now), key=lambda one: one[0])
    # Around a limb that is straight a step goes too far: Levenberg and Marquardt's remedy.
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
    for number, angle in bends(now, axes).items():  # no elbow and no knee bends the wrong way
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


# --- parameters of a body: turns about joints, which leave every bone as long as it is --------------------------------


class Turn(NamedTuple):
  """Joints that are turned about one of them; stiff: how much it takes, against a turn of the shoulder."""
  pivot: int
  moved: np.ndarray  # (22,) whether each joint moves
  stiff: float
  hinge: bool = False  # about one axis, as knees and elbows


def _below(joint: int) -> list[int]:
  """A joint and all that hang from it."""
  found = [joint]
  for one in found:
    found += [child for child, parent in enumerate(HUMANML3D.parents) if parent == one]
  return found


def _turn(pivot: int, joints: list[int], stiff: float, hinge: bool = False) -> Turn:
  moved = np.zeros(HUMANML3D.num_joints, bool)
  for joint in joints:
    moved[_below(joint)] = True
  return Turn(pivot, moved, stiff, hinge)


# From the pelvis outwards. Hips, collars and the neck's root hardly give: only to fit another body's build.
TURNS = (
    _turn(0, [1, 2, 3], 3.0), _turn(0, [1], 12.0), _turn(0, [2], 12.0), _turn(0, [3], 3.0),
    _turn(3, [6], 2.5), _turn(6, [9], 2.5), _turn(9, [12, 13, 14], 2.5), _turn(9, [12], 8.0), _turn(9, [13], 8.0),
    _turn(9, [14], 8.0), _turn(12, [15], 1.0), _turn(13, [16], 4.0), _turn(14, [17], 4.0), _turn(16, [18], 1.0),
    _turn(17, [19], 1.0), _turn(18, [20], 1.0, True), _turn(19, [21], 1.0, True), _turn(1, [4], 1.0),
    _turn(2, [5], 1.0), _turn(4, [7], 1.0, True), _turn(5, [8], 1.0, True), _turn(7, [10], 1.0), _turn(8, [11], 1.0))
_ROOT = 4.0  # how much moving the whole body by a metre takes, against turning a shoulder by a radian

WIDTHS = np.array([1 if turn.hinge else 3 for turn in TURNS])
STARTS = 3 + np.append(0, np.cumsum(WIDTHS))[:-1]  # behind the three by which the body moves as a whole
SIZE = int(3 + WIDTHS.sum())
STIFF = np.concatenate([np.full(3, _ROOT), *(np.full(width, turn.stiff) for turn, width in zip(TURNS, WIDTHS))])


def hinges(joints: Float[np.ndarray, "t 22 3"]) -> dict[int, np.ndarray]:
  """{number of the turn: axes (T, 3)} of elbows and knees: at right angles to the limb's two bones, and smooth."""
  across = rot.unit(joints[:, 1] - joints[:, 2], 1e-9)
  found = {}
  for number, turn in enumerate(TURNS):
    if not turn.hinge:
      continue
    end = HUMANML3D.parents.index(turn.pivot)
    upper = rot.unit(joints[:, turn.pivot] - joints[:, HUMANML3D.parents[turn.pivot]], 1e-9)
    lower = rot.unit(joints[:, end] - joints[:, turn.pivot], 1e-9)
    # A knee bends about the line through the hips; of an elbow that is straight the body's front says how.
    usual = across if turn.pivot in (4, 5) else np.cross(upper, np.cross(across, [0.0, 1.0, 0.0]))
    axis = gaussian_filter1d(np.cross(upper, lower) + _HINGE * usual, 2.0, axis=0, mode="nearest")
    axis = axis - lower * (axis * lower).sum(-1, keepdims=True)
    found[number] = rot.unit(axis, 1e-9)
  return found


def slopes(joints: Float[np.ndarray, "t 22 3"], axes: dict[int, np.ndarray]) -> Float[np.ndarray, "t 22 3 p"]:
  """How places of joints change with the body's P parameters: shifts of all, then turns about joints, radians."""
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
  """{number of the turn: angles (T,)} by which elbows and knees are bent; below 0 the wrong way."""
  found = {}
  for number, axis in axes.items():
    pivot = TURNS[number].pivot
    upper = joints[:, pivot] - joints[:, HUMANML3D.parents[pivot]]
    lower = joints[:, HUMANML3D.parents.index(pivot)] - joints[:, pivot]
    found[number] = np.arctan2((np.cross(upper, lower) * axis).sum(-1), (upper * lower).sum(-1))
  return found


def bent(joints: Float[np.ndarray, "t 22 3"], change: Float[np.ndarray, "t p"], axes: dict[int, np.ndarray]
         ) -> tuple[Float[np.ndarray, "t 22 3"], dict[int, np.ndarray]]:
  """Joints (T, 22, 3) with their parameters changed by (T, P), and their hinges; bones stay as long as they are."""
  result = joints + change[:, None, :3]
  axes = dict(axes)
  for number, (turn, start) in enumerate(zip(TURNS, STARTS)):
    vector = axes[number] * change[:, start:start + 1] if turn.hinge else change[:, start:start + 3]
    about = rot.from_vector(vector)
    arm = result[:, turn.moved] - result[:, turn.pivot, None]
    result[:, turn.moved] = result[:, turn.pivot, None] + rot.rotate(about[:, None], arm)
    for other, axis in axes.items():  # a hinge goes with the limb that it is in
      if other > number and turn.moved[TURNS[other].pivot] and TURNS[other].pivot != turn.pivot:
        axes[other] = rot.rotate(about, axis)
  return result, axes
