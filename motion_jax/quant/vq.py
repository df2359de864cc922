"""Vector quantization with one codebook, updated by moving averages of the vectors that choose each code.

Source: CDAMD eq. 8; docs/papers/cdamd.md#rvq.

No gradient reaches a code. A codebook is state that a training step takes and returns: running sums and counts of the
vectors that chose each code. With `axis_name` these are summed over devices, which then learn the same as a single one.
"""
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.shapes import Array, Bool, Float, Int

# Just below 1: 0.99 + 0.01 may round down where a compiler contracts or reorders, and a code used exactly once must not
# be reset for that.
_ALIVE = 1 - 2.0 ** -24
_EXACT = jax.lax.Precision.HIGHEST  # products in low precision choose other codes and drift


class Codebook(NamedTuple):
  """codes (K, C); sums (K, C) and counts (K,) of the vectors that chose each; initialised (): set by the first batch.

  Several levels are one Codebook of arrays with a leading axis (Q, ...).
  """
  codes: Float[Array, "*q k c"]
  sums: Float[Array, "*q k c"]
  counts: Float[Array, "*q k"]
  initialised: Bool[Array, "*q"]


def empty_codebook(num_codes: int, dim: int, levels: Sequence[int] = (), dtype: Any = jnp.float32) -> Codebook:
  """All zero; the first call of `train` fills it. levels: leading shape, (Q,) for a stack."""
  codes = jnp.zeros(tuple(levels) + (num_codes, dim), dtype)
  # Separate arrays, because donated buffers may not be shared.
  return Codebook(codes, jnp.zeros_like(codes), jnp.zeros(codes.shape[:-1], dtype), jnp.zeros(tuple(levels), bool))


def codebook_of(codes: Float[Array, "*q k c"]) -> Codebook:
  """A Codebook with these codes (..., K, C) and a usage count of 1 for each.

  Parity: released checkpoints hold only the codes; the reference re-initializes its counts from its first batch.
  """
  codes = jnp.asarray(codes)
  return Codebook(codes, codes.copy(), jnp.ones(codes.shape[:-1], codes.dtype), jnp.ones(codes.shape[:-2], bool))


def choose(condition: bool | np.bool_ | Bool[Array, ""], book: Codebook, other: Codebook) -> Codebook:
  return jax.tree.map(lambda a, b: jnp.where(condition, a, b), book, other)


def squared_distances(codes: Float[Array, "k c"], x: Float[Array, "n c"]) -> Float[Array, "n k"]:
  """Squared distances (N, K) of x (N, C) to codes (K, C)."""
  product = jnp.einsum("nc,kc->nk", x, codes, precision=_EXACT)
  return (x ** 2).sum(-1, keepdims=True) - 2 * product + (codes ** 2).sum(-1)


def nearest(codes: Float[Array, "k c"], x: Float[Array, "n c"]) -> Int[Array, " n"]:
  """Indices (N,) of the nearest codes."""
  return jnp.argmin(squared_distances(codes, x), axis=-1)


def sample(codes: Float[Array, "k c"], x: Float[Array, "n c"], gumbel: Float[Array, "n k"], temperature: float = 0.5
           ) -> Int[Array, " n"]:
  """Indices (N,) drawn in proportion to exp(-distance / temperature), by Gumbel noise (N, K)."""
  return jnp.argmax(gumbel - squared_distances(codes, x) / temperature, axis=-1)


def perplexity(counts: Float[Array, " k"]) -> Float[Array, ""]:
  """Perplexity, exp of the entropy of counts (K,): K if all codes are used equally often."""
  p = counts / counts.sum()
  return jnp.exp(-(p * jnp.log(p + 1e-7)).sum())


def first_rows(x: Float[Array, "n c"], num_rows: int, noise: Float[Array, "_ c"], axis_name: str | None = None
               ) -> Float[Array, "{num_rows} c"]:
  """The first rows (num_rows, C) of x (N, C), gathered in order of devices; if there are fewer, they are repeated, and
  noise (num_rows, C) times 0.01 / sqrt(C) is added to all."""
  rows = x[:num_rows]
  if axis_name is not None:
    rows = jax.lax.all_gather(rows, axis_name, tiled=True)
  if len(rows) >= num_rows:
    return rows[:num_rows]
  copies = -(-num_rows // len(rows))
  return jnp.tile(rows, (copies, 1))[:num_rows] + noise * (0.01 / x.shape[-1] ** 0.5)


def initialise(book: Codebook, x: Float[Array, "n c"], noise: Float[Array, "k c"], axis_name: str | None = None
               ) -> Codebook:
  """Initializes an empty codebook with the first rows of x, each with count 1; others are returned unchanged."""
  rows = first_rows(x, len(book.codes), noise, axis_name)
  from_batch = Codebook(rows, rows, jnp.ones_like(book.counts), jnp.ones_like(book.initialised))
  return choose(book.initialised, book, from_batch)


def usage_counts(indices: Int[Array, " n"], num_codes: int, dtype: Any, axis_name: str | None = None
                 ) -> tuple[Float[Array, "n {num_codes}"], Float[Array, " {num_codes}"]]:
  """How often each code occurs in indices (N,): one-hot rows (N, K) and their sums (K,) over all devices."""
  chosen = jax.nn.one_hot(indices, num_codes, dtype=dtype)
  counts = chosen.sum(0)
  return chosen, counts if axis_name is None else jax.lax.psum(counts, axis_name)


def update(book: Codebook, x: Float[Array, "n c"], indices: Int[Array, " n"], noise: Float[Array, "k c"],
           decay: float = 0.99, axis_name: str | None = None) -> tuple[Codebook, Float[Array, " k"]]:
  """Moves the codes towards the x (N, C) that chose them -> (Codebook, counts (K,) of this batch).

  A code k whose running count is below 1 is dead and is replaced by row k of the batch. Its sum and count are kept, so
  it is replaced at every step until enough rows choose it.
  """
  chosen, counts = usage_counts(indices, len(book.codes), x.dtype, axis_name)
  sums = jnp.einsum("nk,nc->kc", chosen, x, precision=_EXACT)
  if axis_name is not None:
    sums = jax.lax.psum(sums, axis_name)
  new_sums = decay * book.sums + (1 - decay) * sums
  new_counts = decay * book.counts + (1 - decay) * counts
  alive = (new_counts >= _ALIVE)[:, None]
  rows = first_rows(x, len(book.codes), noise, axis_name)
  codes = jnp.where(alive, new_sums / jnp.where(alive, new_counts[:, None], 1), rows)
  return book._replace(codes=codes, sums=new_sums, counts=new_counts), counts


def num_dead(book: Codebook) -> Int[Array, "*q"]:
  """How many codes are below the reset threshold, (...)."""
  return (book.counts < _ALIVE).sum(-1)
