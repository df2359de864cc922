"""Check that joints read from a file or another program are plausible human motion.

The unit follows from the bone lengths: a human's in metres, centimetres, millimetres, inches or feet. A body of another
size, a joint far away, a jump of metres or an impossible frame rate is an error of one sentence that names file, frame
and joint; unusual but usable motion is a warning. numpy, float64.
"""
import warnings

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Array, Num
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}  # metres
_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches", "ft": "feet"}
AXES = {"y": [0, 1, 2], "z": [1, 2, 0], "x": [2, 0, 1]}  # {upward axis of a file: its axes in our order}
_SIZES = 0.25, 2.5      # size of a body relative to the skeleton: from a baby to a giant in a game
_LONGEST = 1.5          # metres, the longest bone
# Mean |log| of the ratio of bone lengths to the skeleton's, without the size. 431 people of 10 sources: at most 0.26;
# their joints in other orders: at least 0.39; SMPL's 24 joints taken for SnapMoGen's: at least 0.48.
ODD = 0.36              # from here on a warning, and the unit cannot be derived from the bones
_OTHER_ORDER = 0.6      # from here on an error
_LOST_BONE = 1.0        # largest contribution of one bone, which may have no length
_NO_LENGTH, _MOST = 0.01, 0.75  # below this share of its length a bone has none; share of bones that must have length
_STRETCH = 0.3          # metres by which a bone may change its length without a warning
_FARTHEST = 100_000     # metres from the origin, where float32 resolves centimetres
_COUNTABLE = 1e15       # larger numbers count as infinite: their squares overflow float32
_STEP, _SPEED = 3.0, 150.0  # metres in one frame and metres a second: a root that exceeds both is an error
_JUMP, _FAST = 1.0, 20.0    # the same of any joint: a warning


def check(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D, fps: float | None = None, name: str = "motion"
          ) -> None:
  """Raises ValueError, beginning with name, unless joints (T, J, 3), in the skeleton's unit, form a plausible body.

  Warns about joints in another order, left and right exchanged, bones of varying length, and jumps. fps: frames per
  second, if known.
  """
  lengths, oddness, metres = _checked(joints, skeleton, fps, name)
  _warn_of_jumps(metres, skeleton, fps, name)
  if is_mirrored(metres, skeleton):
    warnings.warn(f"{name}: left and right are exchanged: the left hip is where a body whose toes point ahead has its "
                  "right one; the file's axes are left-handed (negate one of x, y, z) or its sides are swapped",
                  stacklevel=2)
  if oddness > ODD:
    warnings.warn(f"{name}: bone lengths are unlike a person's; are the joints in the order "
                  f"{', '.join(skeleton.joints[:4])}, ...?", stacklevel=2)
    return
  stretch = np.percentile(lengths, 99, axis=0) - np.percentile(lengths, 1, axis=0)
  if stretch.max() > _STRETCH:
    bone = int(stretch.argmax())
    warnings.warn(f"{name}: the bone to {skeleton.joints[bone + 1]} changes its length by {stretch[bone]:.2f} m",
                  stacklevel=2)


def _checked(joints, skeleton, fps, name):
  """(bone lengths (T, J - 1), their oddness, joints in metres); raises InputError for an implausible skeleton."""
  check_rate(fps, name)
  joints = _array(joints, skeleton, name)
  metres = joints * skeleton.unit
  lengths = _lengths(metres, skeleton)
  size, oddness = _size(lengths, skeleton)
  worst = lengths.max()
  if worst > _LONGEST and (size <= _SIZES[1] or np.median(lengths.max(0)) < worst / 100):
    frame, bone = np.argwhere(lengths > max(_LONGEST, worst / 2))[0]  # its own bone, not those that hang on it
    joint = bone + 1
    raise InputError(f"{name}: frame {frame}: {skeleton.joints[joint]} is {_far(lengths[frame, bone])} from "
                     f"{skeleton.joints[skeleton.parents[joint]]}, expected a bone under {_LONGEST:g} m; a joint got "
                     "lost: cut the frame away or repair the file")
  usual = _SIZES[0] <= size <= _SIZES[1]
  if oddness > (_OTHER_ORDER if usual else ODD):
    raise InputError(f"{name}: the bones fit no person's: joints in another order or of another skeleton; expected "
                     f"{', '.join(skeleton.joints)}")
  if not usual:
    guess = guess_unit(joints, skeleton)
    hint = (f"they fit a body in {_NAMES[guess]}: {_how_to_scale(guess, skeleton)}" if guess and UNITS[guess] !=
            skeleton.unit else "no usual unit makes them a person's; scale them to metres")
    raise InputError(f"{name}: bones are {size:.3g} times as long as a person's; {hint}")
  _check_path(metres, skeleton, fps, name)
  return lengths, oddness, metres


def fault(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D, fps: float | None = None, name: str = "motion"
          ) -> str:
  """The message of the error that `check` raises, or "". Does not warn."""
  try:
    _checked(joints, skeleton, fps, name)
  except ValueError as error:
    return str(error)
  return ""


def check_bones(lengths: Num[Array, " j"], skeleton: Skeleton = HUMANML3D) -> None:
  """Raises ValueError for bone lengths (J,), metres, that are too long for drawing a body."""
  joint = int(np.argmax(lengths))
  if not lengths[joint] <= _LONGEST:
    raise InputError(f"the bone to {skeleton.joints[joint]} is {_far(lengths[joint])} long, expected at most "
                     f"{_LONGEST:g} m to draw a body; are the joints in metres?")


def check_rate(fps: float | None, name: str = "motion") -> None:
  """Raises ValueError unless fps is None or within `FRAME_RATES`."""
  low, high = FRAME_RATES
  if fps is not None and not low <= fps <= high:
    raise InputError(f"{name}: got {fps:g} frames per second, expected {low} to {high}; give another by --fps (fps=)")


def to_unit(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D, unit: str = "auto", up: str = "y",
            name: str = "motion") -> Num[np.ndarray, "t j 3"]:
  """Converts joints (T, J, 3) of any unit and upward axis to the skeleton's unit, y up; warns of a unit it guessed.

  unit: "m", "cm", "mm", "in", "ft", or "auto" to derive it from the bone lengths. up: "y", "z" or "x". Raises
  ValueError for an unknown unit, or bones that fit none.
  """
  if unit != "auto" and unit not in UNITS:
    raise InputError(f"got unit {unit!r}, expected auto, {', '.join(UNITS)}")
  placed = with_y_up(_array(joints, skeleton, name), up)
  if unit == "auto":
    guess = guess_unit(placed, skeleton)
    if guess is None or np.isclose(UNITS[guess], skeleton.unit):
      return placed  # already in the right unit, or `check` reports the fault
    warnings.warn(f"{name}: by its bones it is in {_NAMES[guess]}; --unit (unit=) says it, where that is wrong",
                  stacklevel=2)
    unit = guess
  scale = UNITS[unit] / skeleton.unit
  return placed if np.isclose(scale, 1) else placed * scale


def with_y_up(joints: Num[np.ndarray, "*lead 3"], up: str) -> Num[np.ndarray, "*lead 3"]:
  """Rotates joints (..., 3) with upward axis up ("x", "y", "z", or with a minus before it) to y up."""
  if up == "y":
    return joints
  if up.removeprefix("-") not in AXES:
    raise InputError(f"got up {up!r}, expected {', '.join(AXES)}, or one of these with a minus before it")
  placed = joints[..., AXES[up.removeprefix("-")]]
  return placed * np.array([1, -1, -1], placed.dtype) if up.startswith("-") else placed


def upward_axis(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> str:
  """The upward axis of joints (T, J, 3), from the feet to the neck: "y", "-z", ...; "" if there is none."""
  feet = list(skeleton.left_feet + skeleton.right_feet)
  rise = np.median(joints[:, skeleton.joints.index("neck")] - np.asarray(joints)[:, feet].mean(1), axis=0)
  axis = int(np.abs(rise).argmax())
  alone = abs(rise[axis]) > 3 * np.delete(np.abs(rise), axis).max()
  return ("-" if rise[axis] < 0 else "") + "xyz"[axis] if alone else ""


def is_mirrored(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> bool:
  """Whether joints (T, J, 3) are a mirror image: toes point opposite to left hip x neck, the forward direction."""
  joints = np.asarray(joints, np.float64)
  across = joints[:, skeleton.hips[1]] - joints[:, skeleton.hips[0]]
  ahead = np.cross(across, joints[:, skeleton.joints.index("neck")] - joints[:, 0])
  feet = sum(joints[:, toes] - joints[:, ankle] for ankle, toes in (skeleton.left_feet, skeleton.right_feet))
  along = (ahead * feet).sum(-1)
  return bool(np.median(along) < -0.5 * np.median(np.linalg.norm(ahead, axis=-1) * np.linalg.norm(feet, axis=-1)))


def guess_unit(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> str | None:
  """The unit in which the body of joints (T, J, 3) is closest to the skeleton's size; None if none is plausible."""
  size, oddness = _size(_lengths(np.asarray(joints, np.float64), skeleton), skeleton)
  if not 0 < size < np.inf or oddness > ODD:
    return None
  unit = min(UNITS, key=lambda name: abs(np.log(size * UNITS[name])))
  return unit if _SIZES[0] <= size * UNITS[unit] <= _SIZES[1] else None


def oddness(joints: Num[Array, "t j 3"], skeleton: Skeleton = HUMANML3D) -> float:
  """Deviation of the proportions of joints (T, J, 3), in any unit, from the skeleton's: mean |log| of the ratios."""
  return _size(_lengths(np.asarray(joints, np.float64), skeleton), skeleton)[1]


def _lengths(joints, skeleton):
  """Lengths (T, J - 1) of the bones that end in joints 1, 2, ..."""
  parents = np.array(skeleton.parents[1:])
  with np.errstate(over="ignore", invalid="ignore"):
    return np.linalg.norm(joints[:, 1:] - joints[:, parents], axis=-1)


def _size(lengths, skeleton):
  """(size of a body in metres relative to the skeleton, by the median bone; its oddness: mean |log| of the ratios).

  A few bones without length, such as collars that coincide with the neck, are ignored.
  """
  expected = skeleton.bone_lengths[1:] * skeleton.unit
  ratio = np.median(lengths, axis=0)[expected > 1e-6] / expected[expected > 1e-6]
  size = float(np.median(ratio))
  if not 0 < size < np.inf:
    return size, 0.0
  off = np.minimum(np.abs(np.log(np.maximum(ratio / size, 1e-9))), _LOST_BONE)
  has_length = ratio > _NO_LENGTH * size
  return size, float(off[has_length].mean() if has_length.mean() > _MOST else off.mean())


def _array(joints, skeleton, name):
  """float64 joints (T, J, 3), T > 0, all finite."""
  joints = np.asarray(joints)
  if joints.ndim != 3 or joints.shape[1:] != (skeleton.num_joints, 3) or not len(joints):
    raise InputError(f"{name}: got joints of shape {joints.shape}, expected (frames, {skeleton.num_joints}, 3)")
  if joints.dtype.kind not in "fiu":
    raise InputError(f"{name}: got joints of type {joints.dtype}, expected numbers")
  with np.errstate(over="ignore", invalid="ignore"):  # from a wider float, or a NaN that signals
    joints = joints.astype(np.float64)  # before it is compared: _COUNTABLE is beyond what a half float holds
  finite = (np.abs(joints) < _COUNTABLE).all(-1)
  if not finite.all():
    frame, joint = np.argwhere(~finite)[0]
    raise InputError(f"{name}: {(~finite.all(1)).sum()} of {len(joints)} frames hold NaN or infinity, the first is "
                     f"frame {frame}, {skeleton.joints[joint]}; cut them away or repair the file")
  return joints


def _check_path(metres, skeleton, fps, name):
  """Raises ValueError for a body too far away or a root that jumps."""
  far = np.abs(metres).max((1, 2))
  if far.max() > _FARTHEST:
    raise InputError(f"{name}: frame {far.argmax()} is {_far(far.max())} from the origin, expected at most "
                     f"{_FARTHEST / 1000:g} km; take the place of the first frame off all of them")
  if len(metres) < 2:
    return
  rate, root = fps or skeleton.fps, np.linalg.norm(np.diff(metres[:, 0], axis=0), axis=-1)
  if ((root > _STEP) & (root * rate > _SPEED)).any():
    frame = int(root.argmax())
    raise InputError(f"{name}: frame {frame + 1}: {skeleton.joints[0]} has moved {_far(root[frame])} since the frame "
                     f"before, {root[frame] * rate:,.0f} m/s; cut the frames away, or give the right rate by --fps")


def _warn_of_jumps(metres, skeleton, fps, name):
  step = np.linalg.norm(np.diff(metres, axis=0), axis=-1)  # (T - 1, J)
  jumps = (step > _JUMP) & (step * (fps or skeleton.fps) > _FAST)
  if jumps.any():
    frame, joint = np.argwhere(jumps)[0]
    warnings.warn(f"{name}: joints jump over {_JUMP:g} m in {int(jumps.any(1).sum())} frame(s), the first is frame "
                  f"{frame + 1}, {skeleton.joints[joint]}", stacklevel=3)


def _how_to_scale(guess, skeleton):
  to = next(name for name, metres in UNITS.items() if metres == skeleton.unit)
  return (f"--unit {guess} (unit={guess!r}) says so to a reader, in Python multiply joints by "
          f"{UNITS[guess] / UNITS[to]:g}")


def _far(metres):
  return f"{metres / 1000:,.0f} km" if metres >= 10_000 else f"{metres:,.3g} m"


__all__ = ["AXES", "ODD", "UNITS", "check", "check_bones", "check_rate", "fault", "guess_unit", "is_mirrored",
           "oddness", "to_unit", "upward_axis", "with_y_up"]
