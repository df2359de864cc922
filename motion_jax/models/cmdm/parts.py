"""Per-segment captions in training, for clips joined from several: each latent sees the words of its own part alone.

This teaches the denoiser to follow several prompts in sequence, where the words change from block to block
(`multi_prompt`); a caption of the whole clip does not say when its parts happen.
"""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.data.batches import ALL, Segments
from motion_jax.shapes import Bool, Float, Int


def most_parts(spans: Sequence[Segments]) -> int:
  """How many parts the clips have at most."""
  return max(map(len, spans), default=0)


def part_of_blocks(segments: Segments, num_blocks: int, frames_per_block: int) -> Int[np.ndarray, " {num_blocks}"]:
  """The part of each block: the one that holds its middle frame; after the end of the last part, that one."""
  middles = (np.arange(num_blocks) + 0.5) * frames_per_block
  ends = [past for _, _, past in segments]
  return np.minimum(np.searchsorted(ends, middles, side="right"), len(segments) - 1)


def time_left(num_frames: Int[np.ndarray, " b"], segments: Sequence[Segments], count: int, frames_per_latent: int,
              block: int) -> Int[np.ndarray, "b {count}"]:
  """How many latents each latent's caption has left, itself included: up to the end of the clip, or of its part.

  num_frames (B,): of the clips; segments: the parts of each, () for one caption; count: latents of a row. 0 and less
  after the end.
  """
  ends = np.repeat(-(-num_frames[:, None] // frames_per_latent), count, axis=1)
  for row, spans in zip(ends, segments):
    if len(spans) > 1:
      part = np.repeat(part_of_blocks(spans, -(-count // block), block * frames_per_latent), block)[:count]
      borders = np.searchsorted(part, part, side="right")
      row[:] = np.where(part == part[-1], row, np.minimum(borders, row))
  return (ends - np.arange(count)).astype(np.int32)


def words_by_part(encoder: Any, said: Sequence[str], segments: Sequence[Segments], parts: int, num_frames: int,
                  frames_per_latent: int, block: int, at_least: int, rows: slice = ALL
                  ) -> dict[str, Float[np.ndarray, "b s e"] | Bool[np.ndarray, "b l s"]]:
  """text_emb (B, S, E) and text_mask (B, L, S) of captions, with the words of `parts` captions side by side in S.

  said: one caption per clip, whose words all its latents see if the clip has no segments; else each block sees the
  words of its segment. num_frames: of the padded clips; L is that in latents. encoder, at_least, rows: see
  `TextEncoder.__call__`.
  """
  texts = [[text for text, _, _ in spans] or [caption] for caption, spans in zip(said, segments)]
  count = num_frames // frames_per_latent
  shown = np.zeros((len(texts), count, parts), bool)
  for row, spans in zip(shown, segments):
    part = part_of_blocks(spans, -(-count // block), block * frames_per_latent) if spans else np.zeros(count, int)
    row[np.arange(count), (np.repeat(part, block) if spans else part)[:count]] = True
  sides = [encoder([row[min(place, len(row) - 1)] for row in texts], at_least=at_least, rows=rows)
           for place in range(parts)]
  width = max(mask.shape[1] for _, mask in sides)
  emb, mask = (np.stack([np.pad(side[i], [(0, 0), (0, width - side[i].shape[1])] + [(0, 0)] * (1 - i))
                         for side in sides], axis=1) for i in (0, 1))
  seen = shown[rows][..., None] & mask[:, None]
  return {"text_emb": emb.reshape(len(emb), parts * width, -1), "text_mask": seen.reshape(*seen.shape[:2], -1)}
