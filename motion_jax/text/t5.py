"""T5's encoder, versions 1.0 and 1.1, also for Sentence-T5.

Positions enter only as a learned relative bias of the attention scores, which are not scaled. Norms have no mean and no
bias, linear layers no bias. Recorded numbers: tests/fixtures/text.
"""
import math
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.attention import RMSNorm, dot_product_attention
from motion_jax.nets.post_norm import ACTIVATIONS
from motion_jax.text.names import params_from_names

T5_ACTIVATIONS = ACTIVATIONS | {"silu": jax.nn.silu}
IGNORED = r"decoder\.|lm_head\."  # the decoder, in files of a whole T5
TABLES = ("shared.weight", "encoder.embed_tokens.weight")  # two names of the same array


def distance_buckets(distance, num_buckets=32, max_distance=128):
  """The row of the bias table for each distance (key - query), an integer array.

  Half of the rows are for later keys. Of each half, one half is for single distances, the other for ranges that grow by
  a constant factor up to max_distance; the last row is for all larger distances.
  """
  half = num_buckets // 2
  exact = half // 2
  size = np.abs(distance)
  # In float32, as in the reference: rounding matters at the borders of ranges.
  ratio = np.log(np.maximum(size, 1).astype(np.float32) / np.float32(exact))
  ratio = ratio / np.float32(math.log(max_distance / exact))
  far = np.minimum(exact + (ratio * np.float32(half - exact)).astype(np.int64), half - 1)
  return np.where(distance > 0, half, 0) + np.where(size < exact, size, far)


class T5Layer(nn.Module):
  """Norm, attention, add; norm, feed-forward part, add. Shapes: x (B, S, D), key_mask (B, S), bias (H, S, S)."""
  num_heads: int
  head_width: int
  mlp_width: int
  activation: str
  gated: bool
  eps: float
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, key_mask, bias):
    width = x.shape[-1]
    dense = lambda size, name: nn.Dense(size, use_bias=False, dtype=self.dtype, name=name)
    norm = lambda name: RMSNorm(self.eps, self.dtype, name=name)
    y = norm("attn_norm")(x)
    heads = lambda y: y.reshape(*y.shape[:-1], self.num_heads, self.head_width)
    query, key, value = (heads(dense(self.num_heads * self.head_width, name)(y)) for name in ("query", "key", "value"))
    y = dot_product_attention(query, key, value, key_mask[:, None, None, :], bias[None], scaled=False)
    x = x + dense(width, "out")(y.reshape(*y.shape[:-2], -1))
    y = norm("mlp_norm")(x)
    gate = T5_ACTIVATIONS[self.activation](dense(self.mlp_width, "mlp_in")(y))
    if self.gated:
      gate = gate * dense(self.mlp_width, "mlp_linear")(y)
    return x + dense(width, "mlp_out")(gate)


class T5Encoder(nn.Module):
  """T5's encoder. Shapes: ids (B, S) word pieces, text_mask (B, S) True = real -> last hidden states (B, S, D)."""
  vocab_size: int
  width: int
  head_width: int
  num_layers: int
  num_heads: int
  mlp_width: int
  activation: str = "relu"   # version 1.0; 1.1 has a gated gelu_new
  gated: bool = False
  num_buckets: int = 32
  max_distance: int = 128
  max_positions: int = 512   # the length of T5's training; no parameter has this size
  eps: float = 1e-6
  dtype: Any = jnp.float32

  def setup(self):
    self.words = nn.Embed(self.vocab_size, self.width, embedding_init=nn.initializers.normal(1.0), dtype=self.dtype)
    self.distances = nn.Embed(self.num_buckets, self.num_heads, embedding_init=nn.initializers.normal(0.1),
                              dtype=self.dtype)
    self.layers = [T5Layer(self.num_heads, self.head_width, self.mlp_width, self.activation, self.gated, self.eps,
                           self.dtype) for _ in range(self.num_layers)]
    self.norm = RMSNorm(self.eps, self.dtype)

  def position_bias(self, length):
    """The bias of all attention scores of `length` word pieces, (H, S, S): the same in every layer."""
    place = np.arange(length)
    buckets = distance_buckets(place[None, :] - place[:, None], self.num_buckets, self.max_distance)
    return self.distances(jnp.asarray(buckets)).transpose(2, 0, 1)

  def hidden_states(self, ids, text_mask):
    """The embeddings and the output of each layer, the last one normalized: num_layers + 1 arrays."""
    bias, states = self.position_bias(ids.shape[1]), [self.words(ids)]
    for layer in self.layers:
      states.append(layer(states[-1], text_mask, bias))
    return states[:-1] + [self.norm(states[-1])]

  def __call__(self, ids, text_mask):
    return self.hidden_states(ids, text_mask)[-1]


def t5_fields(config):
  """Fields of `T5Encoder` from a config.json of model_type t5; raises ValueError for an unknown option."""
  if config.get("model_type") != "t5":
    raise ValueError(f"got a text encoder of model_type {config.get('model_type')!r}, expected 't5'")
  gate, _, activation = config.get("feed_forward_proj", "relu").rpartition("-")
  if gate not in ("", "gated") or activation not in T5_ACTIVATIONS:
    raise ValueError(f"got feed_forward_proj {config['feed_forward_proj']!r}, expected one of "
                     f"{', '.join(T5_ACTIVATIONS)}, with or without 'gated-' before it")
  if gate and activation == "gelu":
    activation = "gelu_new"  # the meaning of 'gated-gelu' in transformers
  try:
    return dict(
        vocab_size=config["vocab_size"], width=config["d_model"], head_width=config["d_kv"],
        num_layers=config["num_layers"], num_heads=config["num_heads"], mlp_width=config["d_ff"],
        activation=activation, gated=bool(gate), num_buckets=config.get("relative_attention_num_buckets", 32),
        max_distance=config.get("relative_attention_max_distance", 128), eps=config.get("layer_norm_epsilon", 1e-6))
  except KeyError as error:
    raise ValueError(f"the config of a t5 encoder lacks {error}") from error


def names(fields):
  """Our path -> (PyTorch name, kind) of each weight of a T5Encoder with these fields."""
  table = {("words",): ("shared", "embed"), ("norm",): ("encoder.final_layer_norm", "scale"),
           ("distances",): ("encoder.block.0.layer.0.SelfAttention.relative_attention_bias", "embed")}
  parts = {"query": "0.SelfAttention.q", "key": "0.SelfAttention.k", "value": "0.SelfAttention.v",
           "out": "0.SelfAttention.o", "attn_norm": "0.layer_norm", "mlp_norm": "1.layer_norm",
           "mlp_in": "1.DenseReluDense.wi", "mlp_out": "1.DenseReluDense.wo"}
  if fields["gated"]:
    parts |= {"mlp_in": "1.DenseReluDense.wi_0", "mlp_linear": "1.DenseReluDense.wi_1"}
  for i in range(fields["num_layers"]):
    for ours, theirs in parts.items():
      table[f"layers_{i}", ours] = f"encoder.block.{i}.layer.{theirs}", "scale" if "norm" in ours else "linear"
  return table


def params_from_reference(state, fields, dtype=np.float32):
  """Params of `T5Encoder(**fields)` from a state dict of a T5EncoderModel or of a whole T5, whose decoder is left out.

  Raises ValueError that lists missing, unknown or misshapen arrays.
  """
  state = dict(state)
  tables = [state.pop(name) for name in TABLES if name in state]
  if len(tables) == 2 and not np.array_equal(*tables):
    raise ValueError(f"the weights have two different word tables, {' and '.join(TABLES)}; expected one array")
  if tables:
    state[TABLES[0]] = tables[0]
  return params_from_names(state, names(fields), T5Encoder(**fields), IGNORED, dtype)
