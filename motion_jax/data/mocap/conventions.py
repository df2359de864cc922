"""Guess conventions that capture files do not state: the unit of their coordinates and the upward axis.

Both are derived from the bones and reported by a warning, so that a wrong guess can be corrected.
"""
import warnings

import numpy as np

from motion_jax.motion import plausibility
from motion_jax.motion.retarget import leg_scale
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError

_UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254, "feet": 0.3048,
          "decimetres": 0.1, "CMU's unit of 1 / 0.45 inch": 0.0254 / 0.45}
_METRIC = ("metres", "centimetres", "millimetres")
_ADULT, _CHILD = 1.2, 1.6       # how many times longer or shorter legs may be than an adult's; a child's or a giant's
_SIZES = 0.4, 4.0              # times that a body of a stated unit may be enlarged to become an adult: a giant, a baby
_LEVEL = 0.15                   # of the legs' length: what is so near to 0 is on the floor
_LOW = 0.6                      # of the legs' length: the pelvis of a body that does not stand or sit on a chair


def to_metres(joints, unit, name, stated=None, skeleton=HUMANML3D, usual=""):
  """Joints (T, J, 3) in metres, and metres per unit: as `unit` says, or of the usual unit that makes legs an adult's.

  stated: metres per unit that the file itself states; joints are in metres then. A body for which no usual unit fits
  becomes as large as an adult. usual: the unit that gets no warning; with it, `stated` gives way to the bones where it
  makes the body no person's. Each other guess is a warning that begins with name.
  """
  if isinstance(unit, str) and unit != "auto":
    if unit not in plausibility.UNITS:
      raise InputError(f"got unit {unit!r}, expected auto, {', '.join(plausibility.UNITS)}")
    unit = plausibility.UNITS[unit]
  if unit not in ("auto", None):
    return joints * (unit / (stated or 1)), unit
  scale = leg_scale(joints, skeleton) * skeleton.unit
  if stated and not usual:
    _warn(f"{name}: by its skeleton file, 1 unit is {stated:.4g} m; --unit (unit=) corrects it")
    return joints, stated
  if stated and _SIZES[0] < scale < _SIZES[1]:
    return joints, stated
  if stated:  # what the file states makes it no person's
    joints, scale, usual = joints / stated, scale * stated, ""
  label = min(_UNITS, key=lambda label: abs(np.log(_UNITS[label] / scale)))
  metres, off = _UNITS[label], np.exp(abs(np.log(_UNITS[label] / scale)))
  if off > (_CHILD if label in _METRIC else _ADULT):
    metres = float(f"{scale:.3g}")
    _warn(f"{name}: no usual unit makes its legs a person's; scaled to an adult's size, 1 unit is {metres:g} m; --unit "
          "(unit=) corrects it")
  elif off > _ADULT:
    legs = skeleton.bone_lengths[list(skeleton.leg_bones)].sum() * skeleton.unit * metres / scale
    _warn(f"{name}: by its bones it is in {label}, with legs of {legs:.2f} m; --unit (unit=) corrects it")
  elif label != usual:
    _warn(f"{name}: by its bones it is in {label}; --unit (unit=) corrects it")
  return joints * metres, metres


def with_y_up(joints, up, rest, name, skeleton=HUMANML3D):
  """Joints (T, J, 3) turned so that up is +y.

  up: an axis as `plausibility.with_y_up` takes it, or "auto": that of the rest pose (J, 3) if it is a standing pose,
  else the axis along which the head is above the feet. A body lying down in a file with y up looks like a standing body
  in a file with z up; a body counts as standing only if its feet are on the floor in the motion, and if it does not lie
  on the floor in the rest pose.
  """
  if up == "auto":
    up = _upward_axis(joints, rest, name, skeleton)
  return plausibility.with_y_up(joints, up)


def _upward_axis(joints, rest, name, skeleton):
  feet = list(skeleton.left_feet + skeleton.right_feet)
  rise = np.median(joints[:, skeleton.joints.index("neck")] - joints[:, feet].mean(1), axis=0)
  shown, seen = _standing_axis(rest, skeleton), _axis_of(rise, 2.0)
  if seen is None or seen == shown:
    return shown or "y"
  legs = skeleton.bone_lengths[list(skeleton.leg_bones)].sum() / leg_scale(joints, skeleton)
  stands = _lowest(joints[:, feet], seen) < _LEVEL * legs
  if shown is None:
    # People do not stand on their heads for most of a clip, but may lie with the head in any direction.
    up = seen if stands or not seen.startswith("-") else "y"
  else:
    lies = (_lowest(joints, shown) < _LEVEL * legs
            and np.median(plausibility.with_y_up(joints[:, 0], shown)[:, 1]) < _LOW * legs)
    up = seen if stands and not lies else shown
  if up != seen and seen.strip("-") != up:
    _warn(f"{name}: the body lies, or stands along {seen}; it is read with {up} up; --up={seen} (up=\"{seen}\") "
          "corrects it")
  elif up != "y":
    _warn(f"{name}: by its motion {up} is up; --up=y (up=\"y\") corrects it")
  return up


def _standing_axis(rest, skeleton):
  """The upward axis of a standing pose (J, 3), such as "y" or "-z"; None for other poses."""
  hips = rest[list(skeleton.hips)].mean(0)
  trunk = rest[skeleton.joints.index("neck")] - hips
  legs = rest[[skeleton.left_feet[0], skeleton.right_feet[0]]].mean(0) - hips
  upright = (trunk * legs).sum() < -0.7 * np.linalg.norm(trunk) * np.linalg.norm(legs)
  return _axis_of(trunk - legs, 2.0) if upright else None


def _lowest(joints, up):
  """How far from 0 the lowest of joints (T, N, 3) usually is along an axis."""
  return abs(np.percentile(plausibility.with_y_up(joints, up)[..., 1].min(1), 5))


def _axis_of(vector, share):
  """The axis, such as "y" or "-z", along which a vector (3,) is `share` times as long as along any other; else None."""
  order = np.argsort(np.abs(vector))
  if not np.abs(vector[order[2]]) > share * np.abs(vector[order[1]]):
    return None
  return ("-" if vector[order[2]] < 0 else "") + "xyz"[order[2]]


def _warn(message):
  warnings.warn(message, stacklevel=4)
