"""Constraints as arrays: target positions of joints per frame, target headings, and the placement of a motion.

All kinds of constraint are compiled to a `ControlSignal` (`control.compiling`); networks, guidance and projection read
it. In its own frame a motion begins at x = z = 0 and faces +Z; `placement` gives the transform to the world.
"""
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import flax.struct
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.motion.rotations import namespace, rotate_about_y

NUM_JOINTS = 22
_MOVES = 0.1  # metres: least length of a path that defines a direction


@flax.struct.dataclass
class ControlSignal:
  """Target positions and headings per frame, with a flag for each; absent targets have value 0 and flag False.

  Metres, Y up, in the motion's own frame: a motion starts at x = z = 0 and faces +Z, as in HumanML3D.
  """
  positions: Any      # float (B, T, 22, 3)
  given: Any          # bool (B, T, 22, 3), of each coordinate: a path on the floor gives only x and z of the pelvis
  heading: Any        # float (B, T), radians about +Y: 0 faces +Z, a half of pi +X
  heading_given: Any  # bool (B, T)

  @property
  def batch(self) -> int:
    return int(self.given.shape[0])

  @property
  def frames(self) -> int:
    return int(self.given.shape[1])

  @property
  def is_empty(self) -> bool:
    """Whether there is no target. For concrete arrays only, not inside jit."""
    return not (bool(self.given.any()) or bool(self.heading_given.any()))

  def slice_frames(self, start: int, stop: int) -> Self:
    """Frames start to stop, stop excluded. Frames past the end have no targets."""
    cut = lambda x: x[:, start:stop]
    short = stop - max(start, self.frames)
    if stop <= self.frames:
      return jax.tree.map(cut, self)
    return jax.tree.map(lambda x: namespace(x).pad(cut(x), ((0, 0), (0, short)) + ((0, 0),) * (x.ndim - 2)), self)


def none(batch: int, frames: int) -> ControlSignal:
  """An empty signal (batch, frames): no targets."""
  shape = (batch, frames, NUM_JOINTS, 3)
  return ControlSignal(jnp.zeros(shape), jnp.zeros(shape, bool), jnp.zeros(shape[:2]), jnp.zeros(shape[:2], bool))


def stack(signals: Sequence[ControlSignal]) -> ControlSignal:
  """Concatenates signals along the batch; shorter ones have no targets past their ends."""
  frames = max(signal.frames for signal in signals)
  padded = [signal.slice_frames(0, frames) for signal in signals]
  return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *padded)


def errors(signal: ControlSignal, joints: Any) -> jax.Array:
  """Distances (B, T, 22), metres, of joints (B, T, 22, 3) from their targets, over the given coordinates.

  0 where nothing is given. Differentiable, with gradient 0 where nothing is given or a joint is in its place.
  """
  square = jnp.where(signal.given, joints - signal.positions, 0.0) ** 2
  total = square.sum(-1)
  there = total > 0  # the root of 0 has no gradient
  return jnp.where(there, jnp.sqrt(jnp.where(there, total, 1.0)), 0.0)



class Placement(NamedTuple):
  """World position on the floor (x, z) and heading, radians, of a motion's first frame."""
  x: float = 0.0
  z: float = 0.0
  heading: float = 0.0


def placement(signal: ControlSignal) -> Placement:
  """The placement implied by a signal (1, T): the pelvis target of the first frame and its heading target, or else the
  direction of the path. Without a pelvis target in the first frame: the origin, facing +Z."""
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


def to_model_frame(signal: ControlSignal, place: Placement) -> ControlSignal:
  """Transforms a signal (1, T) from world coordinates to the frame of a motion that begins at `place`."""
  given = np.asarray(signal.given)
  x, y, z = np.moveaxis(np.asarray(signal.positions, np.float64) - [place.x, 0, place.z], -1, 0)
  across = given[..., 0] & given[..., 2]
  if place.heading and (given[..., 0] != given[..., 2]).any():
    raise ValueError("a coordinate that is given without the other of the ground cannot be turned")
  at = rotate_about_y(np.stack([x, y, z], -1), -place.heading)
  at[~across] = np.stack([x, y, z], -1)[~across]
  heading = np.asarray(signal.heading) - np.float32(place.heading)
  return ControlSignal(np.where(given, at, 0).astype(np.float32), given,
                       np.where(signal.heading_given, heading, 0).astype(np.float32), np.asarray(signal.heading_given))


def to_world_frame(joints: np.ndarray, place: Placement) -> np.ndarray:
  """Transforms joints (T, J, 3) of a motion that begins at `place` to world coordinates; unchanged for the origin."""
  if place == Placement():
    return joints
  return (rotate_about_y(joints, place.heading) + [place.x, 0, place.z]).astype(joints.dtype)
