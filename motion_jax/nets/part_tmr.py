"""Part-TMR, the motion-language teacher of CMDM: a transformer per body part, a feature per frame.

Source: docs/papers/cmdm.md#part-tmr.
"""
import functools
import math
import operator
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.post_norm import TokenTransformer
from motion_jax.shapes import Array, Bool, Float


class ProjectionHead(nn.Module):
  """p = linear(x); LayerNorm(p + dropout(linear(gelu(p)))): (..., D) -> (..., E)."""
  dim: int
  dropout: float = 0.5
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x: Float[Array, "*lead d"], deterministic: bool = True) -> Float[Array, "*lead e"]:
    p = nn.Dense(self.dim, dtype=self.dtype, name="projection")(x)
    y = nn.Dense(self.dim, dtype=self.dtype, name="fc")(jax.nn.gelu(p, approximate=False))
    y = nn.Dropout(self.dropout, deterministic=deterministic)(y)
    return nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name="norm")(p + y)


class Teacher(nn.Module):
  """Base of the motion-language teachers: heads, pooling and temperature; a subclass defines `encode_motion`.

  `frames` gives a feature per frame (B, T, E), `motion_vector` one per motion (B, E), `text_head` one per sentence from
  the first hidden state (B, W) of the text transformer, a separate module (`text.bert`). x (B, T, F) normalized
  features, frame_mask (B, T) True = real.
  """
  width: int = 512
  depth: int = 4
  num_heads: int = 4
  mlp_width: int = 1024
  dim: int = 256
  dropout: float = 0.1
  head_dropout: float = 0.5
  pool: str = "all"  # Parity: "all" averages padded frames too, as the code does; "real" does not; "token" is TMR's
  dtype: Any = jnp.float32

  def setup(self) -> None:
    if self.pool not in ("all", "real", "token"):
      raise ValueError(f"got pool {self.pool!r}, expected all, real or token")
    self.make_encoder()
    self.motion_projection = ProjectionHead(self.dim, self.head_dropout, self.dtype)
    self.text_projection = ProjectionHead(self.dim, self.head_dropout, self.dtype)
    # Parity: fixed at 1 / 0.07 in the code, for no optimizer holds it; `optimizer.rates` says whether it learns here.
    self.logit_scale = self.param("logit_scale", nn.initializers.constant(math.log(1 / 0.07)), ())

  def encode(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "#b t"] | None, deterministic: bool
             ) -> tuple[Float[Array, "b t d"], Float[Array, "b d"]]:
    # Parity: the code has no padding mask, so padded frames are seen; "all" keeps that.
    return self.encode_motion(x, None if self.pool == "all" else frame_mask, deterministic)

  def hidden(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "#b t"] | None = None, deterministic: bool = True
             ) -> Float[Array, "b t d"]:
    """Frame outputs (B, T, D) before the head."""
    return self.encode(x, frame_mask, deterministic)[0]

  def frames(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "#b t"] | None = None, deterministic: bool = True
             ) -> Float[Array, "b t e"]:
    """A feature per frame (B, T, E), the target of the tokenizer's alignment loss."""
    return self.motion_projection(self.hidden(x, frame_mask, deterministic), deterministic)

  def motion_vector(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "#b t"] | None = None,
                    deterministic: bool = True) -> Float[Array, "b e"]:
    """One vector per motion (B, E), not normalized."""
    hidden, token = self.encode(x, frame_mask, deterministic)
    if self.pool == "token":
      return self.motion_projection(token, deterministic)
    features = self.motion_projection(hidden, deterministic)
    if self.pool == "all" or frame_mask is None:
      return features.mean(1)
    weight = frame_mask[..., None].astype(features.dtype)
    return (features * weight).sum(1) / jnp.maximum(weight.sum(1), 1)

  def text_head(self, hidden: Float[Array, "b w"], deterministic: bool = True) -> Float[Array, "b e"]:
    return self.text_projection(hidden, deterministic)

  def scale(self) -> Float[Array, ""]:
    """The inverse temperature, the factor on cosine similarities."""
    return jnp.exp(self.logit_scale)

  def __call__(self, x: Float[Array, "b t f"], text_hidden: Float[Array, "b w"]
               ) -> tuple[Float[Array, "b e"], Float[Array, "b e"], Float[Array, ""]]:
    return self.motion_vector(x), self.text_head(text_hidden), self.scale()


class PartTMR(Teacher):
  """A transformer per body part; its frame outputs are averaged over the parts.

  parts: ((name, columns), ...) of the normalized features, from `motion.body_parts`; one may be the whole body.
  """
  parts: Sequence[Sequence] = ()

  def make_encoder(self) -> None:
    self.encoders = [TokenTransformer(self.width, self.depth, self.num_heads, self.mlp_width, self.dropout, self.dtype,
                                      name=f"motion_{name}") for name, _ in self.parts]

  def split(self, x: Float[Array, "b t f"]) -> dict[str, Float[Array, "b t _"]]:
    """Features (B, T, F) -> {part: its columns (B, T, n)}."""
    return {name: x[..., np.array(columns)] for name, columns in self.parts}

  def encode_motion(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "#b t"] | None, deterministic: bool
                    ) -> tuple[Float[Array, "b t d"], Float[Array, "b d"]]:
    streams = self.split(x)
    outputs = [encoder(streams[name], frame_mask, deterministic)
               for encoder, (name, _) in zip(self.encoders, self.parts)]
    mean = lambda arrays: functools.reduce(operator.add, arrays) / len(outputs)
    return mean([y[:, 1:] for y in outputs]), mean([y[:, 0] for y in outputs])
