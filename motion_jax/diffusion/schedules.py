"""Tables of times: row m is the time of every latent after m steps, 0 = noise, 1 = clean.

Full-sequence, frame-wise and autoregressive sampling differ in this table only.
"""
from collections.abc import Sequence

import numpy as np

from motion_jax.shapes import Float, Int, Whole


def staircase_levels(num_steps: Whole, length: Whole, lag: Whole, block: Whole = 1) -> Int[np.ndarray, "n {length}"]:
  """Numbers of steps done by each latent, (N + 1, L) integers 0..num_steps: block j starts after j * lag steps.

  lag 0 is all at once, lag num_steps is autoregressive. N = num_steps + lag (blocks - 1); with num_steps 4, lag 2:

    0 0 0        (block 1, L 3; times are these numbers over num_steps)
    1 0 0
    2 0 0
    3 1 0
    4 2 0
    4 3 1
    4 4 2  ...
  """
  if num_steps < 1 or length < 1 or lag < 0 or block < 1:
    raise ValueError(f"got num_steps {num_steps}, length {length}, lag {lag}, block {block}; expected positive numbers")
  # Parity: the paper's lag is per latent, the code's per block of 3; block = 1 gives the paper's.
  blocks = -(-length // block)
  step = np.arange(num_steps + lag * (blocks - 1) + 1)[:, None]
  return np.clip(step - lag * (np.arange(length) // block), 0, num_steps)


def staircase(num_steps: Whole, length: Whole, lag: Whole, block: Whole = 1) -> Float[np.ndarray, "n {length}"]:
  """Frame-wise sampling (CMDM eq. 13; docs/papers/cmdm.md#fss) as times (N + 1, L), float32."""
  return time_of_level(staircase_levels(num_steps, length, lag, block), num_steps)


def time_of_level(level: Int[np.ndarray, "*dims"] | Sequence[int], num_steps: Whole) -> Float[np.ndarray, "..."]:
  """Time after `level` of num_steps steps; computed as 1 - k / K, bitwise equal to the reference."""
  return (1 - (num_steps - np.asarray(level)) / num_steps).astype(np.float32)
