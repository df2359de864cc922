"""Sampling by unmasking: each decoding iteration samples some of the masked latents, until none is left.

A schedule (`schedule`) says in which iteration each latent is sampled for good. The reference samples in
every iteration all that are still masked and discards most results; here the diffusion head runs on the latents that an
iteration unmasks, `Plan.num_rows` at a time: the same motion, as a solver with fixed steps treats every row alone.

With `Plan.window` the transformer runs on the positions that can have changed since the iteration before, and attends
to cached keys and values of those before them: exact under the causal mask, where a latent sees none after it.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.shapes import Array, Bool, Float, Int


class Schedule(NamedTuple):
  """In which decoding iteration each latent (B, L) is sampled for good, counting from 0; -1: it is kept.

  made_at: among the iterations of its motion that unmask anything; drawn_at: among all, which its noise depends on.
  num_iterations (): of the longest motion.
  """
  made_at: Int[Array, "b l"]
  drawn_at: Int[Array, "b l"]
  num_iterations: Any


def schedule(masked: Bool[np.ndarray, "n b l"], unmasked_only: bool = True) -> Schedule:
  """The schedule of a table of masked latents (N, B, L). unmasked_only: iterations that unmask nothing are left out."""
  last = len(masked) - 1 - np.argmax(masked[::-1], axis=0)
  drawn_at = made_at = np.where(masked.any(0), last, -1).astype(np.int32)
  if unmasked_only:
    made_at = np.stack([np.searchsorted(np.unique(row[row >= 0]), row) for row in drawn_at]).astype(np.int32)
    made_at = np.where(drawn_at < 0, -1, made_at)
  count = made_at.max() + 1 if unmasked_only else len(masked)
  return Schedule(made_at, drawn_at, np.int32(count))


def span(made_at: Int[np.ndarray, "b l"]) -> int:
  """The window that the causal mask needs: the most positions of a motion from the first that a decoding iteration
  unmasked to the last that the next one does."""
  widest = 0
  for row in made_at:
    first = 0
    for k in range(row.max() + 1):
      places = np.flatnonzero(row == k)
      widest, first = max(widest, places[-1] + 1 - first), places[0]
  return int(widest)


def most_unmasked(counts: Int[np.ndarray, "n b"]) -> int:
  """The most latents that one iteration of counts (N, B) unmasks in one motion: rows that its solver needs."""
  return int(-np.diff(counts, axis=0, append=0).min())


class State(NamedTuple):
  """Latents (B, L, C) and the keys and values of all positions, with a window."""
  latents: Float[Array, "b l c"]
  caches: Any


def decoding_step(condition: Callable[..., Any], solve: Callable[..., Array], draw: Callable[..., Array],
                  schedule: Schedule, mask_latent: Float[Array, "1 1 c"], num_rows: int | None, window: int | None
                  ) -> Callable[..., State]:
  """step(k, state) -> the state after decoding iteration k. Pure; k may be traced.

  condition(z (B, W, C), masked (B, L), caches, start) -> ((G B, W, H), caches), G branches of guidance one after the
  other; W is the window, from positions start (B,) on, or all L. solve(condition (G B, R, H), rows (B, R), fresh) ->
  (B, R, C), where fresh(j) is the j-th noise (B, R, C) that it needs and rows say which of its results are used.
  draw(k (B, R), j, places (B, R)) -> that noise, of iterations k. num_rows R: only latents that the iteration unmasks,
  R of each motion at a time; None: all that are masked, as the reference does.
  """
  made_at, drawn_at, (batch, length) = *map(jnp.asarray, schedule[:2]), schedule.made_at.shape
  row, size = jnp.arange(batch)[:, None], num_rows or length
  # A loop of a known length where one chunk is enough for every iteration.
  enough = isinstance(schedule.made_at, np.ndarray) and max(
      np.bincount(iterations[iterations >= 0], minlength=1).max() for iterations in schedule.made_at) <= size
  most_chunks = 1 if num_rows is None or enough else None

  def step(k, state):
    z, masked = state.latents, made_at >= k
    wanted = masked if num_rows is None else made_at == k
    seen = jnp.where(masked[..., None], mask_latent.astype(z.dtype), z)
    start: Any = None
    if window is not None:  # from the first latent that this iteration or the one before changes
      changed = (made_at == k) | (made_at == k - 1)
      start = jnp.where(k == 0, 0, jnp.minimum(jnp.argmax(changed, axis=1), length - window))
      seen = seen[row, start[:, None] + jnp.arange(window)]
    conditions, caches = condition(seen, masked, state.caches, start)
    branches = conditions.shape[0] // batch
    # The wanted places first, in order; others follow, whose results are dropped.
    order = jnp.argsort(~wanted, axis=-1, stable=True)

    def chunk(i, z):
      places = jax.lax.dynamic_slice_in_dim(order, i * size, size, axis=1)
      rows = wanted[row, places]
      at = jnp.tile(places if start is None else places - start[:, None], (branches, 1))[..., None]
      rows_of = jnp.take_along_axis(conditions, jnp.clip(at, 0, conditions.shape[1] - 1), axis=1)
      iteration = jnp.broadcast_to(k, places.shape) if num_rows is None else drawn_at[row, places]
      solved = solve(rows_of, rows, lambda j: draw(iteration, j, places)).astype(z.dtype)
      return z.at[row, places].set(jnp.where(rows[..., None], solved, z[row, places]))

    chunks = most_chunks or (wanted.sum(-1).max() + size - 1) // size
    return State(jax.lax.fori_loop(0, chunks, chunk, z), caches)

  return step
