"""A critic of motion for adversarial losses: temporal convolutions on how joints move, at several frame rates."""
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Float

from motion_jax.metrics.physics import in_body_frame
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Array

_SIZES = (0.5, 1.0, 10.0)  # m, m/s, m/s^2: what positions, velocities and accelerations are divided by


def seen(joints: Float[Array, "b t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[Array, "b t-2 n"]:
  """What the critic sees of joints (B, T, J, 3): positions in the body's frame with the pelvis's height, and their
  first two differences, which of the pelvis are those over the ground; (B, T - 2, 9 J)."""
  metres, fps = joints * skeleton.unit, skeleton.fps
  local = jax.vmap(lambda clip: in_body_frame(clip, skeleton))(metres)
  local = local.at[:, :, 0, 1].set(metres[:, :, 0, 1])
  velocity = jnp.diff(local, axis=1).at[:, :, 0].set(jnp.diff(metres[:, :, 0], axis=1)) * fps
  acceleration = jnp.diff(velocity, axis=1) * fps
  parts = [part / size for part, size in zip((local[:, 2:], velocity[:, 1:], acceleration), _SIZES)]
  return jnp.concatenate([part.reshape(*part.shape[:2], -1) for part in parts], axis=-1)


class MotionCritic(nn.Module):
  """Scores of windows of motion, high for real ones, by one tower of convolutions for each stride.

  Weight-normalized, as in the critics of neural audio codecs (SoundStream, arXiv 2107.03312).
  """
  width: int = 64
  strides: Sequence[int] = (1, 2, 4)
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "b t n"]) -> list[list[Float[Array, "b _ _"]]]:
    """x (B, T, N) of `seen` -> for each stride the outputs of its layers, of which the last are scores (B, t, 1)."""
    towers = []
    for stride in self.strides:
      y = nn.avg_pool(x, (stride,), (stride,)) if stride > 1 else x
      layers = []
      for i, (times, step) in enumerate(((1, 1), (1, 2), (2, 2), (2, 1))):
        conv = nn.Conv(times * self.width, (5,), (step,), dtype=self.dtype, name=f"stride{stride}_{i}")
        y = nn.leaky_relu(nn.WeightNorm(conv, name=f"norm{stride}_{i}")(y), 0.2)
        layers.append(y)
      out = nn.Conv(1, (3,), dtype=self.dtype, name=f"stride{stride}_out")
      towers.append([*layers, nn.WeightNorm(out, name=f"norm{stride}_out")(y)])
    return towers
