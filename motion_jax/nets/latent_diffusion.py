"""MLD's networks: a transformer VAE whose latent is a few tokens for a whole motion, and the denoiser of these tokens.

Source: docs/papers/mld.md#vae, #denoiser.
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.post_norm import PostNormDecoderLayer, sinusoid_table
from motion_jax.nets.skip_transformer import SkipTransformer
from motion_jax.shapes import Array, Bool, Float, Int

Gaussian = tuple[Float[Array, "b n d"], Float[Array, "b n d"]]  # mean and log-variance of latents


def positions(module: nn.Module, name: str, x: Float[Array, "b l d"], max_length: int, kind: str = "learned"
              ) -> Float[Array, "b l d"]:
  """Adds positions to x: rows of a learned table or, with kind "sines", of the sinusoidal one."""
  length, width = x.shape[1:]
  if kind == "sines":
    return x + jnp.asarray(sinusoid_table(length, width), x.dtype)
  if length > max_length:
    raise ValueError(f"got a sequence of {length}, this network has positions for {max_length}; take a shorter motion")
  table = module.param(name, nn.initializers.uniform(1.0), (max_length, width))
  return x + table[:length].astype(x.dtype)


class TokenEncoder(nn.Module):
  """x (B, T, F), frame_mask (B, T) -> mean and log-variance (B, N, C) each, of N latents."""
  width: int
  latent_width: int
  num_tokens: int
  stack: Any
  distribution: str
  position_kind: str
  max_length: int
  dtype: Any

  @nn.compact
  def __call__(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None,
               items: Int[Array, " b"] | None = None) -> Gaussian:
    count = self.num_tokens * (1 if self.distribution == "linear" else 2)
    tokens = self.param("tokens", nn.initializers.normal(1.0), (count, self.width)).astype(self.dtype)
    frames = nn.Dense(self.width, dtype=self.dtype, name="x_in")(x.astype(self.dtype))
    y: Any = jnp.concatenate([jnp.broadcast_to(tokens, (len(x), *tokens.shape)), frames], axis=1)
    if frame_mask is not None:
      frame_mask = jnp.pad(frame_mask, ((0, 0), (count, 0)), constant_values=True)
    y = positions(self, "positions", y, self.max_length, self.position_kind)
    y = SkipTransformer(**self.stack, dtype=self.dtype, name="layers")(y, frame_mask, items=items)
    y = y[:, :count]
    if self.latent_width:
      y = nn.Dense(self.latent_width, dtype=self.dtype, name="narrow")(y)
    if self.distribution == "linear":
      y = nn.Dense(2 * y.shape[-1], dtype=self.dtype, name="distribution")(y)
      mean, logvar = jnp.split(y, 2, axis=-1)
      return mean, logvar
    return y[:, :self.num_tokens], y[:, self.num_tokens:]


class TokenDecoder(nn.Module):
  """z (B, N, C), frame_mask (B, T) -> features (B, T, F), 0 where not real; queries are the positions alone."""
  features: int
  width: int
  stack: Any
  attends: str
  position_kind: str
  max_length: int
  dtype: Any

  @nn.compact
  def __call__(self, z: Float[Array, "b n d"], frame_mask: Bool[Array, "b t"], items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b t f"]:
    count, z = z.shape[1], z.astype(self.dtype)
    if z.shape[-1] != self.width:
      z = nn.Dense(self.width, dtype=self.dtype, name="widen")(z)
    y: Array = jnp.zeros((*frame_mask.shape, self.width), self.dtype)
    stack = SkipTransformer(**self.stack, dtype=self.dtype, name="layers")
    if self.attends == "memory":
      y = positions(self, "positions", y, self.max_length, self.position_kind)
      y = stack(y, frame_mask, z, items)
    else:
      y = positions(self, "positions", jnp.concatenate([z, y], axis=1), self.max_length, self.position_kind)
      y = stack(y, jnp.pad(frame_mask, ((0, 0), (count, 0)), constant_values=True), items=items)
      y = y[:, count:]
    y = nn.Dense(self.features, dtype=self.dtype, name="out")(y)
    return jnp.where(frame_mask[..., None], y, 0.0)


class TokenVAE(nn.Module):
  """MLD's VAE: x (B, T, F) normalized features of frame_mask (B, T) <-> z (B, num_tokens, latent_dim).

  distribution: where mean and log-variance come from, "tokens" for each or one "linear" layer. decoder: frames attend
  to z as a "memory", or follow it in the sequence of an "encoder". positions: "learned" or "sines". The released
  models have the first of each. latent_width: numbers of a latent, by a linear layer before and after; 0: width.
  """
  features: int = 263
  width: int = 256
  num_tokens: int = 1
  depth: int = 9
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  distribution: str = "tokens"
  decoder: str = "memory"
  position_kind: str = "learned"
  max_length: int = 500  # number of learned positions, including those of the tokens
  latent_width: int = 0
  dtype: Any = jnp.float32

  def setup(self) -> None:
    for name, known in (("distribution", ("tokens", "linear")), ("decoder", ("memory", "encoder")),
                        ("position_kind", ("learned", "sines"))):
      if getattr(self, name) not in known:
        raise ValueError(f"got {name} {getattr(self, name)!r} for MLD's VAE, expected {' or '.join(known)}")
    stack = dict(depth=self.depth, num_heads=self.num_heads, mlp_width=self.mlp_width, dropout=self.dropout)
    shared: dict[str, Any] = dict(stack=stack, position_kind=self.position_kind, max_length=self.max_length,
                                  dtype=self.dtype)
    self.to_latent = TokenEncoder(self.width, self.latent_width, self.num_tokens, distribution=self.distribution,
                                  **shared, name="encoder")
    self.to_motion = TokenDecoder(self.features, self.width, attends=self.decoder, **shared, name="decoder")

  @property
  def latent_dim(self) -> int:
    return self.latent_width or self.width

  def encode(self, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None,
             items: Int[Array, " b"] | None = None) -> Gaussian:
    """-> mean and log-variance (B, num_tokens, latent_dim)."""
    return self.to_latent(x, frame_mask, items)

  def decode(self, z: Float[Array, "b n d"], frame_mask: Bool[Array, "b t"], items: Int[Array, " b"] | None = None
             ) -> Float[Array, "b t f"]:
    """-> features (B, T, F) of the frames of frame_mask (B, T), 0 elsewhere."""
    return self.to_motion(z, frame_mask, items)

  def __call__(self, x: Float[Array, "b t f"], noise: Float[Array, "b n d"], frame_mask: Bool[Array, "b t"],
               items: Int[Array, " b"] | None = None
               ) -> tuple[Float[Array, "b t f"], Float[Array, "b n d"], Float[Array, "b n d"]]:
    """-> reconstruction by the latent mean + std noise, mean, log-variance."""
    mean, logvar = self.encode(x, frame_mask, items)
    return self.decode(mean + jnp.sqrt(jnp.exp(logvar)) * noise, frame_mask, items), mean, logvar


class TokenDenoiser(nn.Module):
  """MLD's denoiser: z (B, N, D) noisy latents at steps t (B,), text_emb (B, S, E) -> predicted noise (B, N, D).

  A network trained for another target predicts that. With `features` it is the variant without a VAE:
  x (B, T, features) -> (B, T, features), real frames of frame_mask (B, T) attending to each other, to time and to
  words. latent_width: numbers of a latent, by a linear layer before and after; 0: width, without these layers.
  """
  width: int = 256
  depth: int = 9
  num_heads: int = 4
  mlp_width: int = 1024
  text_dim: int = 768
  features: int = 0
  num_steps: int = 1000
  dropout: float = 0.1
  max_length: int = 500
  latent_width: int = 0
  dtype: Any = jnp.float32

  def setup(self) -> None:
    dense = lambda size: nn.Dense(size, dtype=self.dtype)
    self.time_in, self.time_out, self.text_in = dense(self.width), dense(self.width), dense(self.width)

  def time_features(self, t: Int[Array, " b"]) -> Float[Array, "b e"]:
    """Sinusoids (B, text_dim) of steps (B,), cosines first."""
    return jnp.asarray(sinusoid_table(self.num_steps, self.text_dim, cosines_first=True), self.dtype)[t]

  def time(self, t: Int[Array, " b"]) -> Float[Array, "b d"]:
    """The time's token (B, D)."""
    return self.time_out(nn.silu(self.time_in(self.time_features(t))))

  @nn.compact
  def __call__(self, z: Float[Array, "b n c"], t: Int[Array, " b"], text_emb: Float[Array, "b s e"],
               items: Int[Array, " b"] | None = None, frame_mask: Bool[Array, "b n"] | None = None
               ) -> Float[Array, "b n c"]:
    z, text = z.astype(self.dtype), text_emb.astype(self.dtype)
    # Parity: the released code has no layer for text that is as wide as the tokens.
    words = text if self.text_dim == self.width else self.text_in(nn.relu(text))
    tokens = jnp.concatenate([self.time(t)[:, None], words], axis=1)
    sizes: dict[str, Any] = dict(num_heads=self.num_heads, mlp_width=self.mlp_width, dropout=self.dropout,
                                 dtype=self.dtype)
    place = lambda name, y: positions(self, name, y, self.max_length)
    if not self.features:
      if self.latent_width:
        z = nn.Dense(self.width, dtype=self.dtype, name="widen")(z)
      y = place("positions", jnp.concatenate([z, tokens], axis=1))
      y = SkipTransformer(self.depth, **sizes, name="layers")(y, items=items)[:, :z.shape[1]]
      return nn.Dense(self.latent_width, dtype=self.dtype, name="narrow")(y) if self.latent_width else y
    y = place("positions", nn.Dense(self.width, dtype=self.dtype, name="x_in")(z))
    memory = place("memory_positions", tokens)
    attn_mask = None if frame_mask is None else frame_mask[:, None, None]
    for i in range(self.depth):
      y = PostNormDecoderLayer(**sizes, name=f"layer{i}")(y, memory, attn_mask, items=items)
    y = nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name="norm")(y)
    return nn.Dense(self.features, dtype=self.dtype, name="out")(y)
