"""Guidance of frame-wise sampling by constraints, through the decoder, in every second iteration.

The network's estimate of the window's clean latents is decoded after the latents that left the window, and placed where
the motion has arrived; `control.guidance` computes the correction that meets the constraints. A network that was not
trained on constraints meets them this way, and one that was meets them more exactly. Latents that left the window stay
as they are.
"""
import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import flax
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control import guidance
from motion_jax.control.signal import ControlSignal
from motion_jax.latents import VaeCodec
from motion_jax.shapes import Array, Bool, Float, Latents

if TYPE_CHECKING:
  from motion_jax.motion.representations import Representation
  from motion_jax.motion.stats import Stats


class Behind(NamedTuple):
  """The state after the latents that left the window: the decoder's memory, the last row of features (B, 1, F), place
  (B, 2) on the floor and heading (B,)."""
  decoder: Any
  row: Float[Array, "b 1 f"]
  place: Float[Array, "b 2"]
  heading: Float[Array, " b"]


SETTLED = 0.05  # variance that finished latents are taken to have


def variance_of(t: Float[Array, " w"], moves: Bool[Array, " w"]) -> Float[Array, "1 w 1"]:
  """The variance of clean latents at times t (W,) where they have variance 1; 0 where latents do not move."""
  xp = jnp if isinstance(t, jax.Array) else np
  left, t_of = xp.where(moves, 1 - t, 0.0)[:, None], xp.where(moves, t, 1.0)[:, None]
  return (left ** 2 / (left ** 2 + t_of ** 2))[None]


@flax.struct.dataclass
class Guide:
  """Guidance towards a signal of frames (B, T) from block `first` on, with all that turns latents into joints. Made by
  `of`.

  num_steps: conjugate gradient steps of each correction. num_times: further corrections of all finished latents of a
  motion together, which a stream cannot have; with 0 a stream equals the offline motion.
  """
  codec: VaeCodec
  mean: Any
  std: Any
  signal: ControlSignal
  first: Any = 0
  layout: str = flax.struct.field(pytree_node=False, default="full")
  num_steps: int = flax.struct.field(pytree_node=False, default=2)
  num_times: int = flax.struct.field(pytree_node=False, default=0)

  @classmethod
  def of(cls, codec: VaeCodec, stats: "Stats", signal: ControlSignal, num_steps: int = 2, num_times: int = 0) -> Self:
    return cls(codec, stats.mean, stats.std, signal, 0, stats.layout.name, num_steps, num_times)

  @property
  def _layout(self) -> "Representation":
    from motion_jax.motion.representations import get_layout  # a field of a pytree is its name
    return get_layout(self.layout)

  def over(self, frames: int) -> Self:
    """The same over this number of frames; those after the end of the signal are unconstrained."""
    return dataclasses.replace(self, signal=self.signal.slice_frames(0, frames))

  def begin(self) -> Behind:
    """The state before the first block: standing still at the origin, facing +Z."""
    batch = self.signal.given.shape[0]
    row = jnp.zeros((batch, 1, self._layout.dim))
    return Behind(self.codec.init_decode_state(batch), row, jnp.zeros((batch, 2)), jnp.zeros(batch))

  def _world(self, behind, latents):
    """(joints (B, T, J, 3), headings (B, T), `Behind` after them) of the next latents."""
    layout = self._layout
    features, decoder = self.codec.decode_step(latents, behind.decoder)
    rows = jnp.concatenate([behind.row, features * self.std + self.mean], axis=1)
    turned, path = layout.root_path(rows)
    heading = behind.heading[:, None] - 2 * jnp.arctan2(turned[..., 2], turned[..., 0])
    cos, sin = jnp.cos(behind.heading), jnp.sin(behind.heading)

    def place(points):
      spread = lambda a: a.reshape(a.shape + (1,) * (points.ndim - 2))
      x, y, z = points[..., 0], points[..., 1], points[..., 2]
      return jnp.stack([x * spread(cos) + z * spread(sin) + spread(behind.place[:, 0]), y,
                        z * spread(cos) - x * spread(sin) + spread(behind.place[:, 1])], axis=-1)

    joints, path = place(layout.to_joints(rows)[:, 1:]), place(path)
    return joints, heading[:, 1:], Behind(decoder, rows[:, -1:], path[:, -1, ::2], heading[:, -1])

  def move_on(self, behind: Behind, block: Float[Array, "b l c"]) -> Behind:
    """After a clean block left the window."""
    return self._world(behind, block)[2]

  def _residual(self, behind, at, latents):
    frames = latents.shape[1] * self.codec.frames_per_latent
    cut = lambda a: jax.lax.dynamic_slice_in_dim(a, at * self.codec.frames_per_latent, frames, axis=1)
    return guidance.residual(jax.tree.map(cut, self.signal), *self._world(behind, latents)[:2])

  def pull(self, behind: Behind, base: Any, clean: Float[Array, "b w c"], t: Float[Array, " w"],
           moves: Bool[Array, " w"]) -> Float[Array, "b w c"]:
    """The correction of the clean latents that the network predicts in a window at times t (W,), where latents move.
    base: number of latents before the window."""
    return self.newton_step(behind, base, clean, variance_of(t, moves), self.num_steps)

  def newton_step(self, behind: Behind, base: Any, latents: Float[Array, "b w c"], variance: Float[Array, "1 w 1"],
                  num_steps: Any, tolerance: Any = guidance.TOLERANCE) -> Float[Array, "b w c"]:
    """`guidance.newton_step` of latents after `base` others."""
    residual = lambda z: self._residual(behind, base - self.first, z)
    return guidance.newton_step(residual, latents, variance, num_steps, tolerance)

  def settle(self, latents: Latents) -> Latents:
    """Finished latents of whole motions, pulled num_times more."""
    if not self.num_times:
      return latents
    behind = self.begin()
    return guidance.refine(lambda z: self._residual(behind, 0, z), latents, jnp.full((1, latents.shape[1], 1), SETTLED),
                            self.num_times)


def pull(layout: Any, guide: Guide, behind: Behind, times: Array, now: Any, latents: Float[Array, "b w c"],
         clean: Float[Array, "b w c"], iteration: Any, every: Any) -> Float[Array, "b w c"]:
  """Latents of a window after an iteration, pulled towards constraints; every: how many iterations a pull stands for.

  layout, now: a `streaming.Layout` and `streaming.Window`; behind: the state before the window.
  """
  level, then = (jnp.clip(now.levels + i, 0, now.num_steps) for i in (iteration, iteration + 1))
  spread = lambda a: jnp.repeat(a, layout.block)
  moves, t = spread(level < then), spread(times[level])
  share = spread(times[then] - times[level]) / jnp.where(moves, 1 - t, 1.0)
  pulled = guide.pull(behind, now.blocks[0] * layout.block, clean, t, moves).astype(latents.dtype)
  return latents + jnp.minimum(every * share, 1.0)[:, None] * pulled
