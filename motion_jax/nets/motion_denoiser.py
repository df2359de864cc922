"""MDM's network: from noisy features of all frames and a caption to the clean features (docs/papers/mdm.md#network)."""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.gru import GRU
from motion_jax.nets.layers import Dropout
from motion_jax.nets.post_norm import PostNormDecoderLayer, PostNormLayer, sinusoid_table
from motion_jax.shapes import Array, Bool, Float, Int

KINDS = ("encoder", "decoder", "gru")


class MotionDenoiser(nn.Module):
  """x (B, T, F) noisy features at diffusion steps t (B,), from 0 = least noise -> clean features (B, T, F).

  text_emb (B, S, E): a sentence vector (S = 1) or words; all 0 stands for no caption. text_mask (B, S). frame_mask
  (B, T): True = real; without it padding is attended to like any frame. prefix (B, P, F): clean frames directly before
  those of x, which the network reads and does not return. goals (B, num_goals, 4), for a network with goals: three
  coordinates and 1, or 0 for an unused goal; without goals, and for motions whose goals_mask (B,) is False, no
  embedding is added. items (B,), places in the whole batch, switch on dropout, which needs rngs={"dropout": key}.

  kind "encoder": post-norm encoder layers over a token, time plus first word, and the frames. "decoder": frames attend
  to each other and to the words, each with the time added; with time_token the time is also a token before the frames.
  "gru": recurrent layers over the frames, each concatenated with the token.
  In an action model the "caption" is a one-hot vector of the action.
  """
  features: int = 263
  width: int = 512
  depth: int = 8
  num_heads: int = 4
  mlp_width: int = 1024
  text_dim: int = 512
  kind: str = "encoder"
  time_token: bool = False
  num_goals: int = 0
  num_steps: int = 1000  # diffusion steps in training: t < num_steps
  dropout: float = 0.1
  dtype: Any = jnp.float32

  def setup(self) -> None:
    if self.kind not in KINDS:
      raise ValueError(f"got the kind of network {self.kind!r}, expected one of {', '.join(KINDS)}")
    dense = lambda size: nn.Dense(size, dtype=self.dtype)
    self.x_in, self.out = dense(self.width), dense(self.features)
    self.time_in, self.time_out = dense(self.width), dense(self.width)
    self.text_in = dense(self.width)
    if self.num_goals:
      self.goal_in, self.goal_out = dense(self.width), dense(self.width)
    sizes: dict[str, Any] = dict(num_heads=self.num_heads, mlp_width=self.mlp_width, dropout=self.dropout,
                                 dtype=self.dtype)
    layer = {"encoder": lambda name: PostNormLayer(**sizes, name=name),
             "decoder": lambda name: PostNormDecoderLayer(**sizes, name=name),
             "gru": lambda name: GRU(self.width, dtype=self.dtype, name=name)}[self.kind]
    self.layers = [layer(f"layer{i}") for i in range(self.depth)]
    self.drop = Dropout(self.dropout)

  def time(self, t: Int[Array, " b"]) -> Float[Array, "b d"]:
    """The embedding (B, D) of steps (B,)."""
    rows = jnp.asarray(sinusoid_table(self.num_steps, self.width), self.dtype)[t]
    return self.time_out(nn.silu(self.time_in(rows)))

  def text(self, text_emb: Float[Array, "b s e"]) -> Float[Array, "b s d"]:
    """The embedding (B, S, D) of words (B, S, E); for no caption, zeros, it is the layer's bias."""
    return self.text_in(text_emb.astype(self.dtype))

  def goal(self, goals: Float[Array, "b g 4"]) -> Float[Array, "b d"]:
    """The embedding (B, D) of goals (B, G, 4)."""
    return self.goal_out(nn.silu(self.goal_in(goals.reshape(len(goals), -1).astype(self.dtype))))

  def __call__(self, x: Float[Array, "b t f"], t: Int[Array, " b"], text_emb: Float[Array, "b s e"],
               text_mask: Bool[Array, "b s"] | None = None, frame_mask: Bool[Array, "b t"] | None = None,
               prefix: Float[Array, "b p f"] | None = None, goals: Float[Array, "b g 4"] | None = None,
               items: Int[Array, " b"] | None = None, goals_mask: Bool[Array, " b"] | None = None
               ) -> Float[Array, "b t f"]:
    length = x.shape[1]
    time, words = self.time(t)[:, None], self.text(text_emb)
    if goals is not None:
      embedded = self.goal(goals)
      if goals_mask is not None:
        embedded = jnp.where(goals_mask[:, None], embedded, 0)
      time = time + embedded[:, None]
    frames = x if prefix is None else jnp.concatenate([prefix, x], axis=1)
    if frame_mask is not None:
      frame_mask = jnp.pad(frame_mask, ((0, 0), (frames.shape[1] - length, 0)), constant_values=True)
    token = time + words[:, :1] if self.kind != "decoder" else time
    if self.kind == "gru":
      given = jnp.broadcast_to(token, (*frames.shape[:2], self.width))
      frames = jnp.concatenate([frames.astype(self.dtype), given], axis=-1)
    y = self.x_in(frames.astype(self.dtype))
    if self.kind == "encoder" or self.kind == "decoder" and self.time_token:
      y = jnp.concatenate([token, y], axis=1)
      if frame_mask is not None:
        frame_mask = jnp.pad(frame_mask, ((0, 0), (1, 0)), constant_values=True)
    y = self.drop(y + jnp.asarray(sinusoid_table(*y.shape[1:]), self.dtype), items)
    attn_mask = None if frame_mask is None else frame_mask[:, None, None, :]
    for i, layer in enumerate(self.layers):
      if self.kind == "encoder":
        y = layer(y, frame_mask, items=items)
      elif self.kind == "decoder":
        y = layer(y, words + time, attn_mask, memory_mask=text_mask, items=items)
      else:
        # Parity: the released code runs its GRU over the batch instead of over time (docs/papers/mdm.md#network).
        y = y if i == 0 else self.drop(y, items)
        y = layer(y, jnp.zeros((len(y), self.width), y.dtype))
    return self.out(y[:, -length:])
