"""The text half of CLIP: word pieces in, one feature per word piece or one per sentence out.

A causal pre-norm transformer; the sentence feature is that of its end token. How CDAMD uses it:
docs/papers/cdamd.md#transformer.
"""
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.attention import dot_product_attention
from motion_jax.nets.post_norm import ACTIVATIONS
from motion_jax.text.names import check_activation, check_positions, params_from_names

CLIP_ACTIVATIONS = ACTIVATIONS | {"quick_gelu": lambda x: x * jax.nn.sigmoid(1.702 * x)}
# The parts of a CLIPModel other than its text half, and a position buffer of old files.
IGNORED = r"vision_model\.|visual_projection\.|logit_scale$|text_model\.embeddings\.position_ids$"
LEGACY_END = 2  # end token in old config.json files, where the real one is the largest id of a sentence


class ClipLayer(nn.Module):
  """Norm, causal attention, add; norm, feed-forward part, add. Shapes: x (B, S, D), attn_mask (B or 1, 1, S, S)."""
  num_heads: int
  mlp_width: int
  activation: str
  eps: float
  dtype: Any = jnp.float32

  @nn.compact
  def __call__(self, x, attn_mask):
    width = x.shape[-1]
    dense = lambda size, name: nn.Dense(size, dtype=self.dtype, name=name)
    norm = lambda name: nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False, name=name)
    y = norm("attn_norm")(x)
    heads = lambda y: y.reshape(*y.shape[:-1], self.num_heads, width // self.num_heads)
    query, key, value = (heads(dense(width, name)(y)) for name in ("query", "key", "value"))
    y = dot_product_attention(query, key, value, attn_mask)
    x = x + dense(width, "out")(y.reshape(x.shape))
    y = CLIP_ACTIVATIONS[self.activation](dense(self.mlp_width, "mlp_in")(norm("mlp_norm")(x)))
    return x + dense(width, "mlp_out")(y)


class ClipText(nn.Module):
  """CLIP's text transformer.

  Shapes: ids (B, S) word pieces from start to end token, text_mask (B, S) True = real or None -> word features
  (B, S, D). Attention is causal, so real rows do not depend on the mask.
  """
  vocab_size: int
  width: int
  num_layers: int
  num_heads: int
  mlp_width: int
  projection_dim: int = 0      # width P of sentence features; 0: the weights have no projection
  max_positions: int = 77
  activation: str = "quick_gelu"
  eps: float = 1e-5
  end_id: int | None = None    # id of the end token; None: the largest id of a sentence
  dtype: Any = jnp.float32

  def setup(self):
    embed = lambda size: nn.Embed(size, self.width, embedding_init=nn.initializers.normal(0.02), dtype=self.dtype)
    self.words = embed(self.vocab_size)
    self.positions = embed(self.max_positions)
    self.layers = [ClipLayer(self.num_heads, self.mlp_width, self.activation, self.eps, self.dtype)
                   for _ in range(self.num_layers)]
    self.norm = nn.LayerNorm(epsilon=self.eps, dtype=self.dtype, use_fast_variance=False)
    if self.projection_dim:
      self.projection = nn.Dense(self.projection_dim, use_bias=False, dtype=self.dtype)

  def hidden_states(self, ids, text_mask=None):
    """The embeddings and the output of each layer before the last norm: num_layers + 1 arrays (B, S, D)."""
    length = ids.shape[1]
    check_positions(length, self.max_positions)
    attn_mask = jnp.tril(jnp.ones((length, length), bool))[None, None]
    if text_mask is not None:
      attn_mask = attn_mask & text_mask[:, None, None, :]
    states = [self.words(ids) + self.positions(jnp.arange(length))]
    for layer in self.layers:
      states.append(layer(states[-1], attn_mask))
    return states

  def __call__(self, ids, text_mask=None):
    last = self.norm(self.hidden_states(ids, text_mask)[-1])
    if self.projection_dim and self.is_initializing():
      self.projection(last[:, 0])  # so that init creates its parameters
    return last

  def pooled(self, ids, text_mask=None):
    """The feature of the end token, (B, D)."""
    last = self(ids, text_mask)
    row = jnp.argmax(ids if self.end_id is None else ids == self.end_id, axis=1)
    return last[jnp.arange(len(ids)), row]

  def sentence(self, ids, text_mask=None):
    """The sentence feature (B, P): `pooled`, projected into the joint space with images; not at unit length."""
    return self.projection(self.pooled(ids, text_mask))


def clip_fields(config):
  """Fields of `ClipText` from a config.json of model_type clip (a whole CLIPModel) or clip_text_model.

  Defaults are those of ViT-B/32 and B/16. Raises ValueError for an unknown option.
  """
  kind = config.get("model_type")
  if kind not in ("clip", "clip_text_model"):
    raise ValueError(f"got a text encoder of model_type {kind!r}, expected 'clip' or 'clip_text_model'")
  part = config
  if kind == "clip":
    part = (config.get("text_config") or {}) | (config.get("text_config_dict") or {})
  activation = part.get("hidden_act", "quick_gelu")
  check_activation(activation, CLIP_ACTIVATIONS)
  end_id = part.get("eos_token_id", 49407)
  return dict(
      vocab_size=part.get("vocab_size", 49408), width=part.get("hidden_size", 512),
      num_layers=part.get("num_hidden_layers", 12), num_heads=part.get("num_attention_heads", 8),
      mlp_width=part.get("intermediate_size", 2048), max_positions=part.get("max_position_embeddings", 77),
      projection_dim=config.get("projection_dim", 512), activation=activation, eps=part.get("layer_norm_eps", 1e-5),
      end_id=None if end_id == LEGACY_END else end_id)


def names(fields):
  """Our path -> (PyTorch name, kind) of each weight of a ClipText with these fields."""
  table = {("words",): ("text_model.embeddings.token_embedding", "embed"),
           ("positions",): ("text_model.embeddings.position_embedding", "embed"),
           ("norm",): ("text_model.final_layer_norm", "norm")}
  parts = {"query": ("self_attn.q_proj", "dense"), "key": ("self_attn.k_proj", "dense"),
           "value": ("self_attn.v_proj", "dense"), "out": ("self_attn.out_proj", "dense"),
           "attn_norm": ("layer_norm1", "norm"), "mlp_norm": ("layer_norm2", "norm"),
           "mlp_in": ("mlp.fc1", "dense"), "mlp_out": ("mlp.fc2", "dense")}
  for i in range(fields["num_layers"]):
    for ours, (theirs, kind) in parts.items():
      table[f"layers_{i}", ours] = f"text_model.encoder.layers.{i}.{theirs}", kind
  if fields["projection_dim"]:
    table["projection",] = "text_projection", "linear"
  return table


def params_from_reference(state, fields, dtype=np.float32):
  """Params of `ClipText(**fields)` from a state dict of a CLIPTextModel with or without projection, or of a CLIPModel.

  The image half of a CLIPModel is ignored. Raises ValueError that lists missing, unknown or misshapen arrays.
  """
  return params_from_names(state, names(fields), ClipText(**fields), IGNORED, dtype)
