"""MPNet, whose sentence vectors (all-mpnet-base-v2) TMR uses to detect captions of nearly the same meaning.

Source: docs/papers/cmdm.md#tmr.

BERT's layers with learned positions that begin at 2, and T5's relative position bias, shared by all layers. Formulas
and names are those of transformers' modeling_mpnet.py (5.23).
"""
from typing import Any

import flax.linen as nn
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.post_norm import ACTIVATIONS, PostNormLayer
from motion_jax.text.names import check_activation, check_positions, params_from_names
from motion_jax.text.t5 import distance_buckets

FIRST_POSITION = 2  # rows 0 and 1 of the table are for no position and for padding
IGNORED = r"lm_head\.|pooler\.|classifier\.|embeddings\.position_ids$"


class MPNet(nn.Module):
  """MPNet's encoder. Shapes: ids (B, S) word pieces, text_mask (B, S) True = real -> last hidden states (B, S, D)."""
  vocab_size: int
  width: int
  num_layers: int
  num_heads: int
  mlp_width: int
  max_positions: int = 512  # word pieces; the table of positions has FIRST_POSITION more rows
  activation: str = "gelu"
  eps: float = 1e-12
  num_buckets: int = 32
  dtype: Any = jnp.float32

  def setup(self):
    embed = lambda rows, width: nn.Embed(rows, width, embedding_init=nn.initializers.normal(0.02), dtype=self.dtype)
    self.words = embed(self.vocab_size, self.width)
    self.positions = embed(self.max_positions + FIRST_POSITION, self.width)
    self.distances = embed(self.num_buckets, self.num_heads)
    self.norm = nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False)
    self.layers = [PostNormLayer(self.num_heads, self.mlp_width, self.activation, self.eps, dtype=self.dtype)
                   for _ in range(self.num_layers)]

  def __call__(self, ids, text_mask):
    length = ids.shape[1]
    check_positions(length, self.max_positions)
    x = self.norm(self.words(ids) + self.positions(jnp.arange(length) + FIRST_POSITION))
    place = np.arange(length)
    buckets = distance_buckets(place[None, :] - place[:, None], self.num_buckets)
    bias = self.distances(jnp.asarray(buckets)).transpose(2, 0, 1)
    for layer in self.layers:
      x = layer(x, text_mask, bias=bias)
    return x


def mpnet_fields(config):
  """Fields of `MPNet` from a Hugging Face config.json of model_type mpnet; raises ValueError for an unknown option."""
  if config.get("model_type") != "mpnet":
    raise ValueError(f"got a text encoder of model_type {config.get('model_type')!r}, expected 'mpnet'")
  activation = config.get("hidden_act", "gelu")
  check_activation(activation, ACTIVATIONS)
  try:
    return dict(
        vocab_size=config["vocab_size"], width=config["hidden_size"], num_layers=config["num_hidden_layers"],
        num_heads=config["num_attention_heads"], mlp_width=config["intermediate_size"], activation=activation,
        max_positions=config.get("max_position_embeddings", 512) - FIRST_POSITION,
        eps=config.get("layer_norm_eps", 1e-12), num_buckets=config.get("relative_attention_num_buckets", 32))
  except KeyError as error:
    raise ValueError(f"the config of an mpnet encoder lacks {error}") from error


def names(fields):
  """Our path -> (PyTorch name, kind) of each weight of an MPNet with these fields."""
  table = {("words",): ("embeddings.word_embeddings", "embed"), ("norm",): ("embeddings.LayerNorm", "norm"),
           ("positions",): ("embeddings.position_embeddings", "embed"),
           ("distances",): ("encoder.relative_attention_bias", "embed")}
  parts = {"query": "attention.attn.q", "key": "attention.attn.k", "value": "attention.attn.v",
           "out": "attention.attn.o", "attn_norm": "attention.LayerNorm", "mlp_in": "intermediate.dense",
           "mlp_out": "output.dense", "mlp_norm": "output.LayerNorm"}
  for i in range(fields["num_layers"]):
    for ours, theirs in parts.items():
      table[f"layers_{i}", ours] = f"encoder.layer.{i}.{theirs}", "norm" if "norm" in ours else "dense"
  return table


def params_from_reference(state, fields, dtype=np.float32):
  """Params of `MPNet(**fields)` from a state dict, less a leading `mpnet.`; raises ValueError that lists errors."""
  state = {name.removeprefix("mpnet."): array for name, array in state.items()}
  return params_from_names(state, names(fields), MPNet(**fields), IGNORED, dtype)
