"""MotionPatches: a body's chains over time cut into square patches, seen by a small vision transformer.

A teacher of CMDM's Table 9 (MotionPatches, Yu et al., CVPR 2024: chains resampled to 16 points, patches of 16 frames).
"""
import flax.linen as nn
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.part_tmr import Teacher
from motion_jax.nets.post_norm import ACTIVATIONS, sinusoids


def resample(num_joints, num_points):
  """Weights (num_points, num_joints) that put points at equal steps along a chain, between its joints."""
  place = np.linspace(0, num_joints - 1, num_points)
  return np.maximum(1 - np.abs(place[:, None] - np.arange(num_joints)), 0)


class MotionPatches(Teacher):
  """A vision transformer on patches (points of a chain) x (frames), one token per chain and stretch of frames.

  chains: for each chain its joints, each as three columns of the normalized features, -1 where a coordinate is 0 by
  definition (`motion.parts.chain_columns`). A frame's feature is the mean over chains of the tokens of its stretch.
  """
  chains: tuple[tuple[tuple[int, int, int], ...], ...] = ()
  num_points: int = 16
  patch: int = 16

  def make_encoder(self):
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, name=name)
    norm = lambda name: nn.LayerNorm(dtype=self.dtype, use_fast_variance=False, name=name)
    self.embed = dense(self.width, "patch_embed")
    self.token = self.param("token", nn.initializers.normal(0.02), (self.width,))
    self.chain_position = self.param("chain_position", nn.initializers.normal(0.02), (len(self.chains), self.width))
    self.norms = [(norm(f"norm{i}_attn"), norm(f"norm{i}_mlp")) for i in range(self.depth)]
    self.attention = [nn.MultiHeadDotProductAttention(
        self.num_heads, dtype=self.dtype, dropout_rate=self.dropout, name=f"attn{i}") for i in range(self.depth)]
    self.mlps = [(dense(self.mlp_width, f"mlp{i}_in"), dense(self.width, f"mlp{i}_out")) for i in range(self.depth)]
    self.norm = norm("norm")
    self.drop = nn.Dropout(self.dropout)

  def patches(self, x):
    """Features (B, T, F) -> (B, stretches, chains, patch * num_points * 3); the last stretch is filled with zeros."""
    x = jnp.pad(x, ((0, 0), (0, -x.shape[1] % self.patch), (0, 1)))  # the last column is the 0 that -1 points to
    made = []
    for chain in self.chains:
      points = x[..., np.array(chain)]  # (B, T, joints, 3)
      points = jnp.einsum("pj,btjc->btpc", jnp.asarray(resample(len(chain), self.num_points), x.dtype), points)
      made.append(points.reshape(x.shape[0], -1, self.patch * self.num_points * 3))
    return jnp.stack(made, axis=2)

  def encode_motion(self, x, frame_mask, deterministic):
    batch, frames = x.shape[:2]
    if frame_mask is not None:  # what lies behind a clip must not leak through a patch that is half of it
      x = jnp.where(frame_mask[..., None], x, 0.0)
    tokens = self.embed(self.patches(x))
    stretches, chains = tokens.shape[1:3]
    tokens = tokens + sinusoids(stretches, self.width, tokens.dtype)[:, None] + self.chain_position.astype(tokens.dtype)
    first = jnp.broadcast_to(self.token.astype(tokens.dtype), (batch, 1, self.width))
    y = self.drop(jnp.concatenate([first, tokens.reshape(batch, -1, self.width)], axis=1), deterministic)
    mask = None
    if frame_mask is not None:
      real = jnp.repeat(frame_mask[:, ::self.patch], chains, axis=1)  # a stretch is real if it begins inside the clip
      mask = jnp.pad(real, ((0, 0), (1, 0)), constant_values=True)[:, None, None]
    for (norm_attn, norm_mlp), attention, (mlp_in, mlp_out) in zip(self.norms, self.attention, self.mlps):
      z = norm_attn(y)
      y = y + self.drop(attention(z, mask=mask, deterministic=deterministic), deterministic)
      y = y + self.drop(mlp_out(ACTIVATIONS["gelu"](mlp_in(norm_mlp(y)))), deterministic)
    y = self.norm(y)
    hidden = y[:, 1:].reshape(batch, stretches, chains, self.width).mean(2)
    return jnp.repeat(hidden, self.patch, axis=1)[:, :frames], y[:, 0]
