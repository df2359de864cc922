"""The benchmarks' frozen networks, which embed motions and captions in one space.

Source: docs/papers/cmdm.md#evaluators, docs/papers/cdamd.md#matching-evaluator, #clip-evaluator.

`T2MEvaluator` (Guo et al.): movement tokens, recurrent encoders; its embeddings give R-precision, matching, FID and
diversity. `ClipEvaluator` (MARDM): transformers; it gives the CLIP score. Embeddings of different kinds are not
comparable.
"""
import math
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.nets.gru import GRU
from motion_jax.nets.layers import promote_to_f32
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.post_norm import PostNormLayer, sinusoids

_FRAMES_PER_TOKEN = 4
_NORMAL = nn.initializers.glorot_normal()


def _dense(features, dtype, name=None):
  return nn.Dense(features, kernel_init=_NORMAL, dtype=dtype, name=name)


class MovementEncoder(nn.Module):
  """x (B, T, F) -> movement tokens (B, T // 4, dim); token j sees frames 4 j - 3 to 4 j + 6."""
  width: int = 512
  dim: int = 512
  dropout: float = 0.2
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, deterministic=True):
    for i, width in enumerate((self.width, self.dim)):
      x = nn.Conv(width, (4,), strides=(2,), padding=1, kernel_init=_NORMAL, dtype=self.dtype, name=f"conv{i}")(x)
      x = nn.leaky_relu(nn.Dropout(self.dropout, deterministic=deterministic)(x), 0.2)
    return _dense(self.dim, self.dtype, "out")(x)


class MovementDecoder(nn.Module):
  """Movement tokens (B, N, dim) -> (B, 4 N, features): it trains the encoder, as the other half of an autoencoder."""
  features: int
  width: int = 512
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x):
    for i, width in enumerate((self.width, self.features)):
      x = nn.ConvTranspose(width, (4,), strides=(2,), padding="SAME", kernel_init=_NORMAL, dtype=self.dtype,
                           name=f"conv{i}")(x)
      x = nn.leaky_relu(x, 0.2)
    return _dense(self.features, self.dtype, "out")(x)


class SequenceEncoder(nn.Module):
  """A sequence to one vector: x (B, L, W), lengths (B,) -> (B, dim); steps beyond a length have no influence.

  Two GRUs run over the real steps in both directions from a learned first state; their last states are read.
  """
  width: int = 1024
  dim: int = 512
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, lengths):
    x = _dense(self.width, self.dtype, "embed")(x)
    first = self.param("first_state", nn.initializers.normal(1.0), (2, self.width)).astype(self.dtype)
    real_mask = padding_mask(lengths, x.shape[1])
    start = lambda i: jnp.broadcast_to(first[i], (x.shape[0], self.width))
    ahead = GRU(self.width, dtype=self.dtype, name="forward")(x, start(0), real_mask)[:, -1]
    back = GRU(self.width, reverse=True, dtype=self.dtype, name="backward")(x, start(1), real_mask)[:, 0]
    x = _dense(self.width, self.dtype, "mix")(jnp.concatenate([ahead, back], axis=-1))
    x = nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False, name="norm")(x)
    return _dense(self.dim, self.dtype, "out")(nn.leaky_relu(x, 0.2))


class TextEncoder(nn.Module):
  """words (B, S, W) vectors, classes (B, S, 15) one-hot, lengths (B,) -> (B, dim)."""
  width: int = 512
  dim: int = 512
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, words, classes, lengths):
    x = words + _dense(words.shape[-1], self.dtype, "classes")(classes)
    return SequenceEncoder(self.width, self.dim, self.dtype, name="sequence")(x, lengths)


class T2MEvaluator(nn.Module):
  """Embeds motion features and captions in one Euclidean space of `dim` numbers.

  It reads the first `features` of `columns` numbers per frame: 259 of 263 (without contacts), 67 of 67, 66 of 66.
  Motions are normalized with the evaluator's own statistics.
  """
  features: int = 259
  columns: int = 263
  movement_width: int = 512
  movement_dim: int = 512
  motion_width: int = 1024
  text_width: int = 512
  dim: int = 512
  dtype: Any = jnp.float32

  def setup(self):
    self.movement_encoder = MovementEncoder(self.movement_width, self.movement_dim, dtype=self.dtype)
    self.motion_encoder = SequenceEncoder(self.motion_width, self.dim, self.dtype)
    self.text_encoder = TextEncoder(self.text_width, self.dim, self.dtype)

  def movements(self, motion, deterministic=True):
    """motion (B, T, columns) -> (B, T // 4, movement_dim). The convolutions see the padding."""
    return self.movement_encoder(_first_columns(motion, self.features, self.columns), deterministic)

  def motion(self, motion, num_frames):
    """motion (B, T, columns), num_frames (B,) -> (B, dim); num_frames // 4 tokens are read, so 4 frames at least."""
    return self.motion_encoder(self.movements(motion), num_frames // _FRAMES_PER_TOKEN)

  def text(self, words, classes, lengths):
    """The output of `words.WordVectors` -> (B, dim)."""
    return self.text_encoder(words, classes, lengths)

  def __call__(self, words, classes, lengths, motion, num_frames):
    return self.text(words, classes, lengths), self.motion(motion, num_frames)


class ClipEvaluator(nn.Module):
  """Embeds motion features and CLIP tokens in one space of directions.

  It reads the first `features` of `columns` numbers per frame. Text starts from CLIP's own token and position tables,
  which are frozen: no gradient reaches them.
  """
  features: int = 67
  columns: int = 67
  width: int = 512
  depth: int = 8
  num_heads: int = 8
  mlp_width: int = 1024
  dim: int = 512
  vocab_size: int = 49408
  max_words: int = 77
  dropout: float = 0.2
  dtype: Any = jnp.float32

  def setup(self):
    layer = lambda: PostNormLayer(self.num_heads, self.mlp_width, dropout=self.dropout, dtype=self.dtype)
    norm = lambda: nn.LayerNorm(epsilon=1e-5, dtype=self.dtype, use_fast_variance=False)
    self.embed = _dense(self.width, self.dtype)
    self.query = self.param("query", nn.initializers.normal(1.0), (1, self.width))
    self.motion_layers = [layer() for _ in range(self.depth)]
    self.motion_norm, self.motion_out = norm(), _dense(self.dim, self.dtype)
    self.tokens = self.param("tokens", nn.initializers.normal(0.02), (self.vocab_size, self.width))
    self.positions = self.param("positions", nn.initializers.normal(0.01), (self.max_words, self.width))
    self.text_layers = [layer() for _ in range(self.depth)]
    self.text_norm, self.text_out = norm(), _dense(self.dim, self.dtype)
    self.logit_scale = self.param("logit_scale", nn.initializers.constant(math.log(1 / 0.07)), ())
    self.position_dropout = nn.Dropout(self.dropout)

  def motion(self, motion, num_frames, deterministic=True):
    """motion (B, T, columns), num_frames (B,) -> (B, dim), not normalized; padded frames are not seen."""
    x = self.embed(_first_columns(motion, self.features, self.columns))
    query = jnp.broadcast_to(self.query.astype(x.dtype), x[:, :1].shape)
    x = jnp.concatenate([query, x], axis=1)
    x = self.position_dropout(x + sinusoids(x.shape[1], self.width, x.dtype), deterministic=deterministic)
    key_mask = padding_mask(num_frames + 1, x.shape[1])
    for layer in self.motion_layers:
      x = layer(x, key_mask, deterministic)
    return self.motion_out(self.motion_norm(x[:, 0]))

  def text(self, tokens, deterministic=True):
    """tokens (B, S): start, words, end (the largest id), zeros -> (B, dim), not normalized.

    Parity: no mask at all, so also the zeros after the end are attended to; always pad to max_words as CLIP does.
    """
    tables = jax.lax.stop_gradient((self.tokens.astype(self.dtype), self.positions.astype(self.dtype)))
    x = tables[0][tokens] + tables[1][:tokens.shape[1]]
    for layer in self.text_layers:
      x = layer(x, None, deterministic)
    end = jnp.take_along_axis(x, tokens.argmax(-1)[:, None, None], axis=1)[:, 0]
    return self.text_out(self.text_norm(end))

  def scale(self):
    """The factor of cosines in training: the inverse temperature."""
    return jnp.exp(self.logit_scale.astype(promote_to_f32(self.dtype)))

  def __call__(self, tokens, motion, num_frames):
    """-> text and motion, both (B, dim) and of unit length, in the given order."""
    return unit_vectors(self.text(tokens)), unit_vectors(self.motion(motion, num_frames))


def unit_vectors(x):
  """x / |x| over the last axis."""
  return x / jnp.linalg.norm(x, axis=-1, keepdims=True)


def _first_columns(motion, features, columns):
  if motion.shape[-1] != columns:
    raise ValueError(f"got {motion.shape[-1]} features per frame, this evaluator reads {columns}; choose the evaluator "
                     "of the motion's representation or convert the motion")
  return motion[..., :features]
