"""Which latents are masked in training, and which are resampled in each iteration of sampling: tables, no network.

Training hides some of a motion's latents behind noise or a learned vector (docs/papers/cdamd.md#training-step).
Sampling begins with all of them masked; in each decoding iteration those that are still masked are made, and all but a
few of the newly made ones are masked again (docs/papers/cdamd.md#generation). Editing is sampling in which only the
edited latents are ever masked (docs/papers/cdamd.md#editing).
"""
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from motion_jax.models.shared.spans import TASKS
from motion_jax.shapes import Array, Bool, Float, Int, Latents

# --- training ----------------------------------------------------------------------------------------------------


class Corruption(NamedTuple):
  """Corruption of latents (B, L) in training. masked: all that carry loss; of these noised, replaced: see `corrupt`."""
  masked: Bool[Array, "b l"]
  noised: Bool[Array, "b l"]
  replaced: Bool[Array, "b l"]


MASK_DRAWS = ("count", "latent")


def choose_masked(time_u: Float[Array, " b"], order_u: Float[Array, "b l"], real_mask: Bool[Array, "b l"],
                  mask_draw: str = "count") -> Bool[Array, "b l"]:
  """(B, L) which latents carry loss: a random number of them, cosine-distributed, at random places.

  Draws from [0, 1): time_u (B,), order_u (B, L). The number is counted on the padded length and places in the padding
  are left out, so a short motion keeps the same expected share and may get none. mask_draw "latent": each latent is
  masked independently, with that share as its probability.
  """
  # Parity: the paper has a binary mask m_t under a cosine schedule; that a number is drawn is the code's.
  if mask_draw not in MASK_DRAWS:
    raise ValueError(f"got loss.mask_draw {mask_draw!r}, expected one of {', '.join(MASK_DRAWS)}")
  length, share = real_mask.shape[1], jnp.cos(time_u * math.pi * 0.5)
  if mask_draw == "latent":
    return (order_u < share[:, None]) & real_mask
  count = jnp.maximum(1, jnp.round(length * share))
  places = jnp.argsort(order_u, axis=-1)  # a random permutation; its own ranks would do as well
  return (places < count[:, None]) & real_mask


def corruption(time_u: Float[Array, " b"], order_u: Float[Array, "b l"], noise_u: Float[Array, "b l"],
               keep_u: Float[Array, "b l"], real_mask: Bool[Array, "b l"], noise_rate: float = 0.1,
               mask_rate: float = 0.88, mask_draw: str = "count") -> Corruption:
  """Of the latents that carry loss a share noise_rate gets noise, of the rest a share mask_rate the mask latent, and
  what is left stays as it is. noise_u, keep_u (B, L): draws from [0, 1)."""
  # Parity: the paper says 10 % and 88 %; one after the other as in the code they are 10, 79.2 and 10.8 % kept.
  masked = choose_masked(time_u, order_u, real_mask, mask_draw)
  noised = masked & (noise_u < noise_rate)
  return Corruption(masked, noised, masked & ~noised & (keep_u < mask_rate))


def corrupt(latents: Latents, corrupted: Corruption, noise: Latents,
            mask_latent: Float[Array, "1 1 c"], real_mask: Bool[Array, "b l"]) -> Latents:
  """Input of the transformer: latents (B, L, C) with a Corruption applied; mask_latent (1, 1, C), zeros at padding."""
  x = jnp.where(corrupted.noised[..., None], noise, latents)
  x = jnp.where(corrupted.replaced[..., None], mask_latent, x)
  return jnp.where(real_mask[..., None], x, 0.0)


# --- sampling ----------------------------------------------------------------------------------------------------


def masked_shares(num_iterations: int) -> Float[np.ndarray, " {num_iterations}"]:
  """(N,) float32, the share of latents that each iteration finds masked: cos of N even steps from 0 to pi / 2.

  In iteration 2 (N - 1) / 3 it is one half but for the last bit, which decides every odd length. So the steps are those
  of PyTorch, to the last bit: float32, the second half counted back from 1 and rounded once; then a cosine that is
  rounded once, which no float32 cosine promises.
  """
  if num_iterations < 1:
    raise ValueError(f"got {num_iterations} decoding iterations, expected at least 1")
  index, last = np.arange(num_iterations), max(num_iterations - 1, 1)
  step = np.float64(np.float32(1) / np.float32(last))
  times = np.where(index < num_iterations // 2, step * index, 1 - step * (last - index))
  if num_iterations == 1:
    times = np.zeros(1)
  angles = times.astype(np.float32) * np.float32(math.pi) * np.float32(0.5)
  return np.cos(angles.astype(np.float64)).astype(np.float32)


def masked_counts(num_iterations: int, lengths: Int[Array, " b"]) -> Int[np.ndarray, "{num_iterations} b"]:
  """(N, B) integers: how many latents each iteration finds masked, of lengths (B,); at least 1. The reference's.

  10 iterations of 30 latents: 30 30 28 26 23 19 15 10 5 1
  """
  lengths = np.asarray(lengths, np.float32)
  return np.maximum(1, np.round(masked_shares(num_iterations)[:, None] * lengths)).astype(np.int64)


def masked_table(order: Float[Array, "#b l"], counts: Int[Array, "n b"]) -> Bool[np.ndarray, "n b l"]:
  """(N, B, L): which latents each iteration finds masked, those with the smallest numbers in order (B, L).

  Infinity in order: never masked. counts (N, B) must not rise in N; then each iteration's are among those before.

  order  .2  .7  .1  inf      counts 3     1 1 1 .
                                     2     1 . 1 .
                                     1     . . 1 .
  """
  rank = np.argsort(np.argsort(order, axis=-1, kind="stable"), axis=-1, kind="stable")
  return (rank[None] < np.asarray(counts)[:, :, None]) & np.isfinite(order)[None]


def left_to_right(length: int) -> Float[np.ndarray, "1 {length}"]:
  """(1, L), an order that makes the first latents first."""
  return -np.arange(length, dtype=np.float32)[None]


# --- editing -----------------------------------------------------------------------------------------------------


def task_mask(task: str, num_frames: Sequence[int] | Int[Array, " b"], length: int, frames_per_latent: int = 4
              ) -> Bool[np.ndarray, "b {length}"]:
  """(B, L): the latents that an editing task resamples, of motions of num_frames (B,) frames.

  The names say what is given: "prefix" keeps the first half, "suffix" the second, "inpainting" the first and last
  quarter, "outpainting" the middle.

  12 latents   inpainting    . . . 1 1 1 1 1 1 . . .
               outpainting   1 1 1 . . . . . . 1 1 1
               prefix        . . . . . . 1 1 1 1 1 1
               suffix        1 1 1 1 1 1 . . . . . .
  """
  if task not in TASKS:
    raise ValueError(f"got task {task!r}, expected one of {', '.join(TASKS)}")
  num_frames = np.asarray(num_frames)
  total = num_frames // frames_per_latent
  quarter, half = ((share * num_frames).astype(int) // frames_per_latent for share in (0.25, 0.5))
  place = np.arange(length)
  inside = lambda first, past: (place >= first[:, None]) & (place < past[:, None])
  zero = np.zeros_like(total)
  if task == "inpainting":
    return inside(quarter, total - quarter)
  if task == "outpainting":
    return inside(zero, quarter) | inside(total - quarter, total)
  return inside(half, total) if task == "prefix" else inside(zero, half)
