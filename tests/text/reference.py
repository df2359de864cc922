"""Expected values for text encoders: sentence vectors of sentence-transformers, weights under names of PyTorch."""
import jax.numpy as jnp
import numpy as np

from motion_jax.text import bert
from motion_jax.text.names import LEAVES


def mean_words(hidden, text_mask):
  """The mean over real word pieces: (B, S, D), (B, S) -> (B, D)."""
  weight = text_mask[..., None].astype(hidden.dtype)
  return (hidden * weight).sum(1) / weight.sum(1)


def mean_sentence(hidden, text_mask, projection=None):
  """The sentence vector of sentence-transformers, (B, E): the mean over real word pieces, at unit length.

  projection: (E, D), applied before normalization by Sentence-T5.
  """
  mean = mean_words(hidden, text_mask)
  if projection is not None:
    mean = mean @ projection.T
  return mean / jnp.linalg.norm(mean, axis=-1, keepdims=True)


def params_to_reference(params, fields, names=None):
  """The inverse of `bert.params_from_reference`: {PyTorch name: array}, by default under DistilBERT's names."""
  state = {}
  for path, (theirs, kind) in bert._table(fields, names or bert.DISTILBERT_NAMES).items():
    node = params
    for part in path:
      node = node[part]
    for ours, leaf in LEAVES[kind]:
      array = np.asarray(node[ours])
      state[f"{theirs}.{leaf}"] = array.T if ours == "kernel" else array
  return state
