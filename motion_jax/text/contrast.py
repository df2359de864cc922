"""Contrast guidance: move text embeddings of prompts away from those of negative prompts."""
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.shapes import Bool, Float


class Contrast(NamedTuple):
  """negative(prompt): the prompt to move away from, or the prompt itself for none; scale: strength."""
  negative: Callable[[str], str]
  scale: float


def contrasted(encoder: Callable, prompts: Sequence[str], text_emb: Float[np.ndarray, "b s e"],
               text_mask: Bool[np.ndarray, "b s"], contrast: Contrast) -> Float[np.ndarray, "b s e"]:
  """text_emb + scale (text_emb - embedding of the negative prompt), for each prompt (B, S, E) that has one.

  Differences between the two prompts are amplified, as classifier-free guidance amplifies differences of velocities,
  without a further pass of the network. A prompt whose negative has another number of tokens is not changed.
  """
  text_emb = text_emb.copy()
  for row, prompt in enumerate(prompts):
    negative = contrast.negative(prompt)
    if negative == prompt:
      continue
    other = encoder([negative])[0][0]
    if len(other) == text_mask[row].sum():
      features = text_emb[row, :len(other)]
      text_emb[row, :len(other)] = features + np.float32(contrast.scale) * (features - other)
  return text_emb
