"""Where on the ground a motion begins: motions begin at x = z = 0 and face +Z, paths begin where they are drawn."""
from typing import NamedTuple

import numpy as np

from motion_jax.control.compiling import turned
from motion_jax.control.signal import ControlSignal

_MOVES = 0.1  # metres in which a path shows its direction


class Placement(NamedTuple):
  """The ground's point (x, z) at which a motion begins, and the heading in which it does, radians."""
  x: float = 0.0
  z: float = 0.0
  heading: float = 0.0


def placement(signal: ControlSignal) -> Placement:
  """Where a motion (1, T) begins that goes where it is asked to: there the pelvis is asked to be in the first frame,
  faced as asked, or else along its path. Without a place in the first frame it is the origin, faced +Z."""
  given, places = np.asarray(signal.given)[0, :, 0][:, [0, 2]].all(-1), np.asarray(signal.positions)[0, :, 0]
  if not given[0]:
    return Placement()
  x, z = map(float, places[0, [0, 2]])
  if np.asarray(signal.heading_given)[0, 0]:
    return Placement(x, z, float(np.asarray(signal.heading)[0, 0]))
  gone = np.linalg.norm((places - places[0])[:, [0, 2]], axis=-1) * given
  far = np.flatnonzero(gone > _MOVES)
  if not len(far):
    return Placement(x, z)
  ahead = places[far[0]] - places[0]
  return Placement(x, z, float(np.arctan2(ahead[0], ahead[2])))


def into(signal: ControlSignal, place: Placement) -> ControlSignal:
  """A signal (1, T) of the world as the motion sees it that begins at place."""
  given = np.asarray(signal.given)
  x, y, z = np.moveaxis(np.asarray(signal.positions, np.float64) - [place.x, 0, place.z], -1, 0)
  across = given[..., 0] & given[..., 2]
  if place.heading and (given[..., 0] != given[..., 2]).any():
    raise ValueError("a coordinate that is given without the other of the ground cannot be turned")
  at = turned(np.stack([x, y, z], -1), -place.heading)
  at[~across] = np.stack([x, y, z], -1)[~across]
  heading = np.asarray(signal.heading) - np.float32(place.heading)
  return ControlSignal(np.where(given, at, 0).astype(np.float32), given,
                       np.where(signal.heading_given, heading, 0).astype(np.float32), np.asarray(signal.heading_given))


def back(joints: np.ndarray, place: Placement) -> np.ndarray:
  """Joints (T, J, 3) of a motion that begins at place, in the world. The same array where place is the origin."""
  if place == Placement():
    return joints
  return (turned(joints, place.heading) + [place.x, 0, place.z]).astype(joints.dtype)
