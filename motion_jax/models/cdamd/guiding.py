"""Finished latents of CDAMD are pulled towards constraints through the decoder, all of a motion together.

Its latents are unmasked in any order and see one another; where each ends is known only when all are there. So they are
pulled once they are finished, unlike CMDM's, whose decoder looks back alone (`models.cmdm.guiding`).
"""
from typing import Any, Self

import flax
import jax.numpy as jnp

from motion_jax.control import guidance
from motion_jax.control.signal import ControlSignal
from motion_jax.latents import AutoencoderCodec
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import Stats
from motion_jax.shapes import Array, Bool, Latents

VARIANCE = 0.05  # of a finished latent, in units of that of all latents: how far it may be pulled


@flax.struct.dataclass
class Settling:
  """Settings of guidance on finished latents: statistics and layout of the features, and the number of Gauss-Newton
  steps."""
  mean: Any
  std: Any
  num_times: Any
  layout: str = flax.struct.field(pytree_node=False, default="coordinates")

  @classmethod
  def of(cls, stats: Stats, num_times: int) -> Self:
    return cls(stats.mean, stats.std, num_times, stats.layout.name)

  def settle(self, codec: AutoencoderCodec, latents: Latents, real_mask: Bool[Array, "b l"],
             signal: ControlSignal) -> Latents:
    """Latents pulled towards a signal of all frames (B, 4 L)."""
    layout = get_layout(self.layout)

    def residual(z):
      features = codec.decode(z, real_mask) * self.std + self.mean
      turned, _ = layout.root_path(features)
      return guidance.residual(signal, layout.to_joints(features), -2 * jnp.arctan2(turned[..., 2], turned[..., 0]))

    return guidance.refine(residual, latents, jnp.where(real_mask[..., None], VARIANCE, 0.0), self.num_times)
