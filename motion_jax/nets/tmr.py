"""TMR: encoders of motions and of sentences to Gaussians in one latent space, and a decoder from it to motions.

Petrovich, Black, Varol: "TMR: Text-to-Motion Retrieval Using Contrastive 3D Human Motion Synthesis", ICCV 2023; layers
and sizes are those of Mathux/TMR (docs/papers/cmdm.md#tmr). A teacher of CMDM's Table 9.
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.post_norm import PostNormDecoderLayer, TokenTransformer, sinusoids
from motion_jax.shapes import Array, Bool, Float

Rows = tuple[Float[Array, "b d"], Float[Array, "b d"], Float[Array, "b t d"]]  # mean, log-variance, rows


class LatentDecoder(nn.Module):
  """z (B, D), frame_mask (B, T) -> motions (B, T, F), zeros at padding. Queries are the positions alone."""
  features: int
  depth: int
  num_heads: int
  mlp_width: int
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, z: Float[Array, "b d"], frame_mask: Bool[Array, "b t"], deterministic: bool = True
               ) -> Float[Array, "b t f"]:
    places = sinusoids(frame_mask.shape[1], z.shape[-1], self.dtype)
    x: Array = jnp.broadcast_to(places, (*frame_mask.shape, z.shape[-1]))
    x = nn.Dropout(self.dropout, deterministic=deterministic)(x)
    for i in range(self.depth):
      layer = PostNormDecoderLayer(self.num_heads, self.mlp_width, self.dropout, self.dtype, name=f"layer{i}")
      # z is the only key, so its weight is 1: queries and keys of this attention have no effect and no gradient.
      x = layer(x, z[:, None], frame_mask[:, None, None, :], deterministic)
    return jnp.where(frame_mask[..., None], nn.Dense(self.features, dtype=self.dtype, name="out")(x), 0.0)


class TMR(nn.Module):
  """TMR's two encoders and decoder. x (B, T, features) normalized, frame_mask (B, T), text_emb (B, S, W) hidden states
  of a frozen text transformer, text_mask (B, S); True = real.

  pool: the vector of a motion that is compared with sentences, "token", the mean of its Gaussian, as in TMR, or "real",
  the mean of the outputs of its real frames. As a teacher, the network gives these outputs, which no loss of the
  published TMR trains; CMDM does not say how it gets a feature per frame from TMR. "real" trains them, the change that
  CMDM makes to Part-TMR (docs/papers/cmdm.md#frame-features).
  """
  features: int = 263
  width: int = 256
  depth: int = 6
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  pool: str = "token"
  dtype: Any = jnp.float32

  @property
  def dim(self) -> int:
    """Width of a frame's feature and of a motion's vector."""
    return self.width

  def setup(self) -> None:
    if self.pool not in ("token", "real"):
      raise ValueError(f"got pool {self.pool!r} for a TMR, expected token or real")
    sizes = self.depth, self.num_heads, self.mlp_width, self.dropout, self.dtype
    self.motion_encoder = TokenTransformer(self.width, *sizes, num_tokens=2)
    self.text_encoder = TokenTransformer(self.width, *sizes, num_tokens=2)
    self.motion_decoder = LatentDecoder(self.features, *sizes)

  def motion_gaussian(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None,
                      deterministic: bool = True) -> Rows:
    """-> mean (B, D), logvar (B, D), rows (B, T, D)."""
    return _gaussian(self.motion_encoder(x, frame_mask, deterministic))

  def text_gaussian(self, text_emb: Float[Array, "b t w"], text_mask: Bool[Array, "b t"] | None = None,
                    deterministic: bool = True) -> Rows:
    """-> mean (B, D), logvar (B, D), rows (B, S, D)."""
    return _gaussian(self.text_encoder(text_emb, text_mask, deterministic))

  def decode(self, z: Float[Array, "b d"], frame_mask: Bool[Array, "b t"], deterministic: bool = True
             ) -> Float[Array, "b t f"]:
    """A latent of either side (B, D) -> normalized features (B, T, features)."""
    return self.motion_decoder(z, frame_mask, deterministic)

  def frames(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None, deterministic: bool = True
             ) -> Float[Array, "b t d"]:
    """A feature per frame (B, T, D), the target of the tokenizer's alignment loss."""
    return self.motion_gaussian(x, frame_mask, deterministic)[2]

  def motion_vector(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None,
                    deterministic: bool = True) -> Float[Array, "b d"]:
    """One vector per motion (B, D), not normalized."""
    mean, _, rows = self.motion_gaussian(x, frame_mask, deterministic)
    return mean if self.pool == "token" else mean_rows(rows, frame_mask)

  def text(self, text_emb: Float[Array, "b s w"], text_mask: Bool[Array, "b s"] | None = None,
           deterministic: bool = True) -> Float[Array, "b d"]:
    """One vector per sentence (B, D), not normalized."""
    return self.text_gaussian(text_emb, text_mask, deterministic)[0]

  def __call__(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"], text_emb: Float[Array, "b s w"],
               text_mask: Bool[Array, "b s"]) -> tuple[Float[Array, "b d"], Float[Array, "b d"], Float[Array, "b t f"]]:
    z = self.text(text_emb, text_mask)
    return self.motion_vector(x, frame_mask), z, self.decode(z, frame_mask)


def _gaussian(x: Float[Array, "b n d"]) -> Rows:
  """Outputs of a `TokenTransformer` with two tokens as (mean, logvar, rows)."""
  return x[:, 0], x[:, 1], x[:, 2:]


def mean_rows(rows: Float[Array, "b t d"], mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b d"]:
  """The mean of the real rows: (B, T, D), (B, T) or None -> (B, D)."""
  if mask is None:
    return rows.mean(1)
  weight = mask[..., None].astype(rows.dtype)
  return (rows * weight).sum(1) / jnp.maximum(weight.sum(1), 1)
