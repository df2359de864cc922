"""The ways in which a body can be bent: turns about joints that leave every bone as long as it is. numpy, float64."""
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D

_HINGE = 0.1  # of a right angle: a limb that is bent less does not say alone where its hinge is


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
  from scipy.ndimage import gaussian_filter1d
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
