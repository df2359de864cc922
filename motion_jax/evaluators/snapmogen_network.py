"""SnapMoGen's evaluator: a Gaussian per motion and per caption in one space of directions.

Source: docs/papers/cmdm.md#snapmogen.

Motions are the first 148 of 296 features, captions the hidden states of a frozen text encoder (T5 v1.1 base). Pairs are
compared by the cosine of their means; FID uses the activations before the last linear layer.
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp

from motion_jax.nets.masks import padding_mask
from motion_jax.nets.post_norm import PostNormLayer, sinusoids


def _through_layers(module, x, real_mask, deterministic):
  for i in range(module.depth):
    layer = PostNormLayer(module.num_heads, module.mlp_width, dropout=module.dropout, dtype=module.dtype,
                          name=f"layer{i}")
    x = layer(x, real_mask, deterministic)
  return x


class GaussianEncoder(nn.Module):
  """x (B, S, F), real_mask (B, S) -> (state, mean, logvar), each (B, D): two tokens in front gather a sequence.

  state is the first token's state before the linear layer that makes the mean of it.
  """
  width: int = 256
  depth: int = 6
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, real_mask, deterministic=True):
    x = nn.Dense(self.width, dtype=self.dtype, name="embed")(x)
    tokens = self.param("tokens", nn.initializers.normal(1.0), (2, self.width)).astype(self.dtype)
    x = jnp.concatenate([jnp.broadcast_to(tokens, (len(x), *tokens.shape)), x], axis=1)
    x = nn.Dropout(self.dropout, deterministic=deterministic)(x + sinusoids(x.shape[1], self.width, x.dtype))
    real_mask = jnp.pad(real_mask, ((0, 0), (2, 0)), constant_values=True)
    x = _through_layers(self, x, real_mask, deterministic)
    dense = lambda name: nn.Dense(self.width, dtype=self.dtype, name=name)
    return x[:, 0], dense("mean")(x[:, 0]), dense("logvar")(x[:, 1])


class GaussianDecoder(nn.Module):
  """z (B, D), real_mask (B, T) -> motions (B, T, F), zeros where not real: it trains the encoders, as TMR's does.

  SnapMoGen's own attends to the latent (docs/papers/cmdm.md#snapmogen); here it is added to the positions that the
  encoder's kind of layers reads.
  """
  features: int
  depth: int = 6
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, z, real_mask, deterministic=True):
    width = z.shape[-1]
    x = sinusoids(real_mask.shape[1], width, self.dtype) + nn.Dense(width, dtype=self.dtype, name="embed")(z)[:, None]
    x = _through_layers(self, x, real_mask, deterministic)
    return nn.Dense(self.features, dtype=self.dtype, name="out")(x) * real_mask[..., None]


class SnapEvaluator(nn.Module):
  """Both encoders. It reads the first `features` of `columns` numbers per frame."""
  features: int = 148
  columns: int = 148
  width: int = 256
  depth: int = 6
  num_heads: int = 4
  mlp_width: int = 1024
  dropout: float = 0.1
  dtype: Any = jnp.float32

  def setup(self):
    encoder = lambda: GaussianEncoder(self.width, self.depth, self.num_heads, self.mlp_width, self.dropout, self.dtype)
    self.motion_encoder, self.text_encoder = encoder(), encoder()

  def motion_gaussian(self, motion, num_frames, deterministic=True):
    """motion (B, T, columns), num_frames (B,) -> (state, mean, logvar)."""
    if motion.shape[-1] != self.columns:
      raise ValueError(f"got {motion.shape[-1]} features per frame, this evaluator reads {self.columns}; choose the "
                       "evaluator of the motion's representation or convert the motion")
    return self.motion_encoder(motion[..., :self.features], padding_mask(num_frames, motion.shape[1]), deterministic)

  def text_gaussian(self, text_emb, text_mask, deterministic=True):
    """Hidden states (B, S, W) of a text encoder, text_mask (B, S) -> (state, mean, logvar)."""
    return self.text_encoder(text_emb, text_mask, deterministic)

  def motion(self, motion, num_frames):
    """-> (B, D), compared with `text` by the cosine."""
    return self.motion_gaussian(motion, num_frames)[1]

  def motion_for_fid(self, motion, num_frames):
    """-> (B, D), the vectors of FID and diversity."""
    return self.motion_gaussian(motion, num_frames)[0]

  def text(self, text_emb, text_mask):
    return self.text_gaussian(text_emb, text_mask)[1]

  def __call__(self, text_emb, text_mask, motion, num_frames):
    return self.text(text_emb, text_mask), self.motion(motion, num_frames)
