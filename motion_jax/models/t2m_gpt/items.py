"""Clips as rows of codes: made once from a trained quantizer, then drawn with their captions."""
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.data import batches
from motion_jax.latents import RvqCodec
from motion_jax.shapes import Int


def target_row(codes: Int[np.ndarray, " n"], length: int, end: int) -> Int[np.ndarray, " {length}"]:
  """(length,): codes, the end, then padding, end + 1. Codes that leave no room for the end are cut off."""
  row = np.full(length, end + 1, np.int32)
  codes = codes[:length - 1]
  row[:len(codes)], row[len(codes)] = codes, end
  return row


def without_one(codes: Int[np.ndarray, " n"], place: str) -> Int[np.ndarray, " m"]:
  """Codes less the one at the "head" or the "tail"; "whole": all of them."""
  if place == "whole":
    return codes
  return codes[1:] if place == "head" else codes[:-1]


def encode_clips(codec: RvqCodec, features: Sequence[np.ndarray], seed: int, batch_size: int = 64
                 ) -> list[Int[np.ndarray, " n"]]:
  """Codes of each clip (T, F), encoded as if alone, cut to whole codes at a place that seed and number decide."""
  unit = codec.frames_per_latent
  longest = -(-max(map(len, features)) // unit) * unit
  alone = dataclasses.replace(codec, net=codec.net.clone(hide_padding=True), params=jax.device_put(codec.params))
  encode = jax.jit(lambda x, mask: alone.encode(x, mask)[0][..., 0])
  clip_codes = []
  for first in range(0, len(features), batch_size):
    part = features[first:first + batch_size]
    x = np.zeros((batch_size, longest, part[0].shape[-1]), np.float32)
    counts = np.zeros(batch_size, int)
    for row, clip in enumerate(part):
      counts[row] = len(clip) // unit * unit
      start = batches.step_rng(seed, 7, first + row).integers(len(clip) - counts[row] + 1)
      x[row, :counts[row]] = clip[start:start + counts[row]]
    codes = np.asarray(encode(x, np.arange(longest) < counts[:, None]))
    clip_codes += [codes[row, :counts[row] // unit] for row in range(len(part))]
  return clip_codes


@dataclasses.dataclass(frozen=True, eq=False)
class CodeItems:
  """Rows of codes with a caption each, every clip once an epoch.

  codes: (n_i,) of each clip, captions: a list for each; length of a row; end: the code after the last. shorten_rate:
  how often a clip loses one code, at its head or its tail. weights: draws with replacement in proportion to them.
  """
  codes: list[np.ndarray]
  captions: list[list[str]]
  length: int
  end: int
  shorten_rate: float = 1 / 3
  weights: np.ndarray | None = None
  kept: np.ndarray = dataclasses.field(init=False)  # clips that have a code and a caption

  def __post_init__(self) -> None:
    kept = np.array([i for i, (codes, said) in enumerate(zip(self.codes, self.captions)) if len(codes) and said], int)
    if not len(kept):
      raise ValueError(f"none of {len(self.codes)} clips has a whole code and a caption")
    object.__setattr__(self, "kept", kept)

  def __len__(self) -> int:
    return len(self.kept)

  def batch(self, batch_size: int, seed: int, step: int, rows: slice = batches.ALL) -> dict[str, Any]:
    """-> codes (B, length), num_codes (B,), index (B,), of these rows; caption, a list of all B."""
    rng = batches.step_rng(seed, 8, step)
    if self.weights is None:
      chosen = self.kept[batches.epoch_indices(len(self), batch_size, seed, step)]
    else:
      p = np.asarray(self.weights)[self.kept]
      chosen = self.kept[rng.choice(len(self), batch_size, p=p / p.sum())]
    targets, counts, captions = [], [], []
    for i in chosen:
      place = ("head", "tail")[rng.integers(2)] if rng.random() < self.shorten_rate else "whole"
      # Parity: the reference also drops the only code of a clip, which leaves a motion of nothing.
      place = place if len(self.codes[i]) > 1 else "whole"
      codes = without_one(self.codes[i], place)[:self.length - 1]
      targets.append(target_row(codes, self.length, self.end))
      counts.append(len(codes))
      captions.append(self.captions[i][rng.integers(len(self.captions[i]))])
    return {"codes": np.stack(targets)[rows], "num_codes": np.array(counts, np.int32)[rows],
            "index": np.arange(batch_size)[rows], "caption": captions}


