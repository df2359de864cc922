"""MotionPatches: a vision transformer on a motion as an image, time downwards and the body's chains side by side.

Yu, Tanaka, Fujiwara: "Exploring Vision Transformers for 3D Human Motion-Language Models with Motion Patches", CVPR 2024
(docs/papers/cmdm.md#motionpatches). A teacher of CMDM's Table 9.
"""
from collections.abc import Sequence

import flax.linen as nn
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.part_tmr import Teacher
from motion_jax.nets.vit import ViT
from motion_jax.shapes import Array, Bool, Float, Int


def resample(num_joints: int, num_points: int) -> Float[np.ndarray, "{num_points} {num_joints}"]:
  """Weights (num_points, num_joints) that put points along a chain of joints, linear between neighbours.

  Point i lies at (i + 1/2) num_joints / num_points - 1/2, clamped to the ends, as in resizing an image.
  """
  place = (np.arange(num_points) + 0.5) * num_joints / num_points - 0.5
  place = np.clip(place, 0, num_joints - 1)
  return np.maximum(1 - np.abs(place[:, None] - np.arange(num_joints)), 0)


def kit_frames(num_rows: int) -> Int[np.ndarray, " {num_rows}"]:
  """Which frame at 12.5 per second each of num_rows image rows at 20 per second shows: 20 rows for every 12 frames."""
  row = np.arange(num_rows)
  return 12 * (row // 20) + (0.625 * (row % 20)).astype(int)


class MotionPatches(Teacher):
  """A vision transformer on an image of (3 axes, num_rows frames, num_points for each chain), cut into square patches.

  chains: for each chain its joints, each as three columns of the normalized features, -1 where a coordinate is 0 by
  definition (`motion.body_parts.chain_columns`); the layout "coordinates" gives the published image. A shorter clip is
  padded with zeros, which the network sees, as it has no mask; a longer one is cut. upsample: KIT's 12.5 frames per
  second are shown at 20 (`kit_frames`).

  Parity: a clip's vector is the mean over all patch tokens, then a norm, then the head. A frame's feature, which the
  paper does not define, is the same over its row of patches (docs/papers/cmdm.md#frame-features). dropout and pool of
  the other teachers are not used.
  """
  chains: Sequence[Sequence[Sequence[int]]] = ()
  num_points: int = 16
  patch: int = 16
  num_rows: int = 224
  upsample: bool = False

  def make_encoder(self) -> None:
    if self.num_rows % self.patch or self.num_points % self.patch:
      raise ValueError(f"got an image of {self.num_rows} rows and {self.num_points} points a chain, expected multiples "
                       f"of the patch's {self.patch}")
    self.vit = ViT(self.width, self.depth, self.num_heads, self.mlp_width, self.dtype)
    self.fc_norm = nn.LayerNorm(epsilon=1e-6, dtype=self.dtype, use_fast_variance=False)

  @property
  def grid(self) -> tuple[int, int]:
    """Numbers of patches, downwards and across."""
    return self.num_rows // self.patch, len(self.chains) * self.num_points // self.patch

  @property
  def max_frames(self) -> int:
    """How many frames of a clip fit the image."""
    return int(kit_frames(self.num_rows)[-1]) + 1 if self.upsample else self.num_rows

  def image(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None
            ) -> Float[Array, "b 3 rows points"]:
    """Features (B, T, F) -> (B, 3, num_rows, chains * num_points); what is not real is 0."""
    if frame_mask is not None:
      x = jnp.where(frame_mask[..., None], x, 0.0)
    x = x[:, :self.max_frames]
    x = jnp.pad(x, ((0, 0), (0, self.max_frames - x.shape[1]), (0, 1)))  # the last column is the 0 that -1 points to
    if self.upsample:
      x = x[:, kit_frames(self.num_rows)]
    points = [jnp.einsum("pj,btjc->bctp", jnp.asarray(resample(len(chain), self.num_points), x.dtype),
                         x[..., np.array(chain)]) for chain in self.chains]
    return jnp.concatenate(points, axis=-1)

  def tokens(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b n d"]:
    """Tokens (B, 1 + patches, D) of the last block, class token first, patches row by row."""
    image = self.image(x, frame_mask)
    rows, columns = self.grid
    patches = image.reshape(len(x), 3, rows, self.patch, columns, self.patch).transpose(0, 2, 4, 1, 3, 5)
    return self.vit(patches.reshape(len(x), rows * columns, -1))  # a patch: axis slow, then frame, then point

  def features(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b d"]:
    """The normalized mean over patch tokens (B, D). The class token takes part in attention alone."""
    return self.fc_norm(self.tokens(x, frame_mask)[:, 1:].mean(1))

  def hidden(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None, deterministic: bool = True
             ) -> Float[Array, "b t d"]:
    """Each frame's mean over its row of patch tokens, before the head: (B, T, D)."""
    rows = self.tokens(x, frame_mask)[:, 1:].reshape(len(x), *self.grid, -1).mean(2)
    shown = kit_frames(self.num_rows) if self.upsample else np.arange(self.num_rows)
    first = np.searchsorted(shown, np.arange(min(x.shape[1], self.max_frames)))  # the first image row of each frame
    if x.shape[1] > self.max_frames:
      raise ValueError(f"got {x.shape[1]} frames, the image shows {self.max_frames}; cut the motion into pieces")
    return self.fc_norm(rows)[:, first // self.patch]

  def motion_vector(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None,
                    deterministic: bool = True) -> Float[Array, "b e"]:
    """One vector per motion (B, E), not normalized."""
    return self.motion_projection(self.features(x, frame_mask), deterministic)
