"""BERT, MiniLM and DistilBERT: word pieces in, one feature vector per word piece out.

All three are one network: learned positions, post-norm blocks, exact GELU. DistilBERT has no token types and no pooler;
only the names of its weights differ. How CMDM uses it: docs/papers/cmdm.md#text.
"""
import dataclasses
import re
from typing import Any

import flax.linen as nn
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.post_norm import ACTIVATIONS, PostNormLayer
from motion_jax.text.names import check_activation, check_positions, params_from_names


class Bert(nn.Module):
  """A BERT-family encoder.

  Shapes: ids (B, S) word pieces, text_mask (B, S) True = real, type_ids (B, S) segments (all 0 if not given)
  -> last hidden states (B, S, D). Rows outside the mask have no meaning, and no real row attends to them.
  """
  vocab_size: int
  width: int
  num_layers: int
  num_heads: int
  mlp_width: int
  max_positions: int = 512
  num_types: int = 0       # 0: no token types (DistilBERT)
  has_pooler: bool = False
  activation: str = "gelu"
  eps: float = 1e-12
  dtype: Any = jnp.float32

  def setup(self):
    embed = lambda size: nn.Embed(size, self.width, embedding_init=nn.initializers.normal(0.02), dtype=self.dtype)
    self.words = embed(self.vocab_size)
    self.positions = embed(self.max_positions)
    if self.num_types:
      self.types = embed(self.num_types)
    self.norm = nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False)
    self.layers = [PostNormLayer(self.num_heads, self.mlp_width, self.activation, self.eps, dtype=self.dtype)
                   for _ in range(self.num_layers)]
    if self.has_pooler:
      self.pooler = nn.Dense(self.width, dtype=self.dtype)

  def hidden_states(self, ids, text_mask, type_ids=None):
    """The embeddings and the output of each layer: num_layers + 1 arrays (B, S, D)."""
    check_positions(ids.shape[1], self.max_positions)
    x = self.words(ids) + self.positions(jnp.arange(ids.shape[1]))
    if self.num_types:
      x = x + self.types(jnp.zeros_like(ids) if type_ids is None else type_ids)
    states = [self.norm(x)]
    for layer in self.layers:
      states.append(layer(states[-1], text_mask))
    return states

  def __call__(self, ids, text_mask, type_ids=None):
    last = self.hidden_states(ids, text_mask, type_ids)[-1]
    if self.has_pooler and self.is_initializing():
      self.pooler(last[:, 0])  # so that init creates its parameters
    return last

  def pooled(self, ids, text_mask, type_ids=None):
    """tanh(linear) of the first word piece, (B, D): BERT's own sentence vector."""
    return jnp.tanh(self.pooler(self(ids, text_mask, type_ids)[:, 0]))



def bert_fields(config):
  """Fields of `Bert` from a Hugging Face config.json (model_type bert or distilbert).

  Raises ValueError for another model type or an option that this module does not have.
  """
  kind = config.get("model_type")
  if kind not in ("bert", "distilbert"):
    raise ValueError(f"got a text encoder of model_type {kind!r}, expected 'bert' or 'distilbert'")
  distil = kind == "distilbert"
  activation = config.get("activation" if distil else "hidden_act", "gelu")
  check_activation(activation, ACTIVATIONS)
  position_type = config.get("position_embedding_type", "absolute")
  if position_type != "absolute":
    raise ValueError(f"got position_embedding_type {position_type!r}, expected 'absolute'")
  get = lambda bert_name, distil_name: config[distil_name if distil else bert_name]
  try:
    return dict(
        vocab_size=config["vocab_size"], width=get("hidden_size", "dim"),
        num_layers=get("num_hidden_layers", "n_layers"), num_heads=get("num_attention_heads", "n_heads"),
        mlp_width=get("intermediate_size", "hidden_dim"), max_positions=config.get("max_position_embeddings", 512),
        num_types=0 if distil else config.get("type_vocab_size", 2), activation=activation,
        eps=1e-12 if distil else config.get("layer_norm_eps", 1e-12))
  except KeyError as error:
    raise ValueError(f"the config of a {kind} encoder lacks {error}") from error


# Our module path -> the reference's, for BERT and MiniLM, and for DistilBERT.
BERT_NAMES = {
    "words": "embeddings.word_embeddings", "positions": "embeddings.position_embeddings",
    "types": "embeddings.token_type_embeddings", "norm": "embeddings.LayerNorm", "pooler": "pooler.dense",
    "layer": "encoder.layer.", "query": "attention.self.query", "key": "attention.self.key",
    "value": "attention.self.value", "out": "attention.output.dense", "attn_norm": "attention.output.LayerNorm",
    "mlp_in": "intermediate.dense", "mlp_out": "output.dense", "mlp_norm": "output.LayerNorm"}
DISTILBERT_NAMES = {
    "words": "embeddings.word_embeddings", "positions": "embeddings.position_embeddings",
    "norm": "embeddings.LayerNorm", "layer": "transformer.layer.", "query": "attention.q_lin",
    "key": "attention.k_lin", "value": "attention.v_lin", "out": "attention.out_lin", "attn_norm": "sa_layer_norm",
    "mlp_in": "ffn.lin1", "mlp_out": "ffn.lin2", "mlp_norm": "output_layer_norm"}


# Heads and poolers of released files, a position buffer, and a projection that our own folders add.
IGNORED = r"cls\.|vocab_|pooler\.|classifier\.|pre_classifier\.|embeddings\.position_ids$|sentence_projection\."


def _table(fields, names):
  """Our path -> (PyTorch name, kind) of each weight of a Bert with these fields."""
  table = {(ours,): (names[ours], "embed") for ours in ("words", "positions")}
  if fields.get("num_types"):
    table["types",] = names["types"], "embed"
  table["norm",] = names["norm"], "norm"
  for i in range(fields["num_layers"]):
    for kind, parts in (("dense", ("query", "key", "value", "out", "mlp_in", "mlp_out")),
                        ("norm", ("attn_norm", "mlp_norm"))):
      table |= {(f"layers_{i}", ours): (f"{names['layer']}{i}.{names[ours]}", kind) for ours in parts}
  if fields.get("has_pooler"):
    table["pooler",] = names["pooler"], "dense"
  return table


def params_from_reference(state, fields, dtype=np.float32):
  """Params of `Bert(**fields)` from a state dict under PyTorch names, {name: array}.

  A leading `bert.` or `distilbert.` is dropped, gamma/beta are the old names of weight/bias, and heads of the released
  files (`cls.*`, `vocab_*`) are ignored. Raises ValueError that lists missing, unknown or misshapen arrays.
  """
  clean = lambda name: re.sub(r"\.beta$", ".bias", re.sub(r"\.gamma$", ".weight", name))
  state = {re.sub(r"^(bert|distilbert)\.", "", clean(name)): array for name, array in state.items()}
  names = DISTILBERT_NAMES if any(name.startswith("transformer.layer.") for name in state) else BERT_NAMES
  return params_from_names(state, _table(fields, names), Bert(**fields), IGNORED, dtype)


def bert_fields_of(model):
  """The fields of a `Bert` module, as plain values."""
  return {field.name: getattr(model, field.name) for field in dataclasses.fields(model)
          if field.name not in ("dtype", "parent", "name")}
