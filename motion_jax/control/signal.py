"""What a motion is asked to do, as arrays: where joints are to be, frame by frame, and where the body faces.

All kinds of constraint come down to this (`control.constraints`); networks, guidance and the final projection read it.
"""
from collections.abc import Sequence
from typing import Any, Self

import flax.struct
import jax
import jax.numpy as jnp

from motion_jax.motion.rotations import namespace

NUM_JOINTS = 22


@flax.struct.dataclass
class ControlSignal:
  """Places and headings that are asked for; what is not given is 0 and has a False flag.

  World metres, Y up, in the motion's own frame: a motion starts at x = z = 0 and faces +Z, as HumanML3D's do.
  """
  positions: Any      # float (B, T, 22, 3)
  given: Any          # bool (B, T, 22, 3), of each coordinate: a path on the floor gives the pelvis' x and z alone
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
    """Whether nothing is asked for. Of concrete arrays alone: not inside of jit."""
    return not (bool(self.given.any()) or bool(self.heading_given.any()))

  def slice_frames(self, start: int, stop: int) -> Self:
    """The frames start to stop, the last not included. Frames past the end ask for nothing."""
    cut = lambda x: x[:, start:stop]
    short = stop - max(start, self.frames)
    if stop <= self.frames:
      return jax.tree.map(cut, self)
    return jax.tree.map(lambda x: namespace(x).pad(cut(x), ((0, 0), (0, short)) + ((0, 0),) * (x.ndim - 2)), self)


def none(batch: int, frames: int) -> ControlSignal:
  """Nothing asked for of batch motions of so many frames."""
  shape = (batch, frames, NUM_JOINTS, 3)
  return ControlSignal(jnp.zeros(shape), jnp.zeros(shape, bool), jnp.zeros(shape[:2]), jnp.zeros(shape[:2], bool))


def stack(signals: Sequence[ControlSignal]) -> ControlSignal:
  """Signals one behind the other along the batch; shorter ones ask for nothing past their ends."""
  frames = max(signal.frames for signal in signals)
  padded = [signal.slice_frames(0, frames) for signal in signals]
  return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *padded)


def errors(signal: ControlSignal, joints: Any) -> jax.Array:
  """How far joints (B, T, 22, 3) are from where they should be: metres (B, T, 22) over the given coordinates.

  0 where nothing is given. Differentiable, with gradient 0 where nothing is given or a joint is in its place.
  """
  square = jnp.where(signal.given, joints - signal.positions, 0.0) ** 2
  total = square.sum(-1)
  there = total > 0  # the root of 0 has no gradient
  return jnp.where(there, jnp.sqrt(jnp.where(there, total, 1.0)), 0.0)
