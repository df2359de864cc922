"""Residual vector quantization: each level quantizes the residual of the levels before it.

Source: CDAMD eq. 8, 9; docs/papers/cdamd.md#rvq.

A stack of Q levels is one `vq.Codebook` with a leading axis (Q, ...). Pure functions: state in, state out.
"""
from typing import NamedTuple

import jax
import jax.numpy as jnp

from motion_jax import shapes
from motion_jax.quant import vq
from motion_jax.shapes import Array, Float, Int, Key


class Noise(NamedTuple):
  """Random numbers of one training step: gumbel (Q, N, K) for the rows of this device, and start and replace (Q, K, C),
  the same on all devices, added to repeated rows when there are fewer rows than codes."""
  gumbel: Float[Array, "q n k"]
  start: Float[Array, "q k c"]
  replace: Float[Array, "q k c"]


class Quantized(NamedTuple):
  """Result of quantization in a training step.

  quantized (B, L, C), with straight-through gradient; indices (B, L, Q), -1 at unused levels; commitment (): mean
  squared distance of residuals to their codes; perplexity () and usage () (share of the codes that were chosen) over
  the rows of all devices. The last three are means over the active levels.
  """
  quantized: Float[Array, "b l c"]
  indices: Int[Array, "b l q"]
  commitment: Float[Array, ""]
  perplexity: Float[Array, ""]
  usage: Float[Array, ""]


def draw_noise(rng: Key[Array, ""], item_keys: Key[Array, " b"], num_rows: int, codebooks: vq.Codebook) -> Noise:
  """Draws noise for num_rows rows of each item; item_keys (B,) make it the same on any number of devices."""
  levels, num_codes, dim = codebooks.codes.shape
  gumbel = jax.vmap(lambda key: jax.random.gumbel(key, (levels, num_rows, num_codes)))(item_keys)
  gumbel = jnp.moveaxis(gumbel, 0, 1).reshape(levels, -1, num_codes)
  start, replace = jax.random.normal(rng, (2, levels, num_codes, dim))
  return Noise(gumbel, start, replace)


def draw_active(rng: Key[Array, ""], num_levels: int, drop_rate: float) -> Int[Array, ""]:
  """Quantization dropout: how many levels a step uses; all or, with probability drop_rate, 1 to all, uniform."""
  drop_rng, count_rng = jax.random.split(rng)
  count = jax.random.randint(count_rng, (), 1, num_levels + 1)
  return jnp.where(jax.random.bernoulli(drop_rng, drop_rate), count, num_levels)


def train(codebooks: vq.Codebook, x: Float[Array, "b l c"], num_active: int | Int[Array, ""], noise: Noise,
          decay: float = 0.99, temperature: float = 0.5, gain_once: bool = False, axis_name: str | None = None
          ) -> tuple[Quantized, vq.Codebook]:
  """Quantizes x (B, L, C) by sampled codes and updates the codebooks -> (Quantized, codebooks).

  temperature: of the distribution over codes; 0: the nearest code, without noise.
  num_active (): levels in use; the others neither quantize nor learn. All gradients go to x: straight through from
  `quantized`, and from the commitment.
  """
  num_levels, num_codes, dim = codebooks.codes.shape
  rows = x.reshape(-1, dim)
  residual, total = rows, jnp.zeros_like(rows)
  books, indices, terms = [], [], []
  for level in range(num_levels):
    active = level < num_active
    before = vq.Codebook(*(field[level] for field in codebooks))
    frozen = jax.lax.stop_gradient(residual)
    book = vq.initialise(before, frozen, noise.start[level], axis_name)
    chosen = vq.sample(book.codes, frozen, noise.gumbel[level], temperature) if temperature else (
        vq.nearest(book.codes, frozen))
    codes = book.codes[chosen]
    book, counts = vq.update(book, frozen, chosen, noise.replace[level], decay, axis_name)
    terms.append(jnp.where(active, jnp.stack([((residual - codes) ** 2).mean(), vq.perplexity(counts),
                                              (counts > 0).mean(dtype=x.dtype)]), 0.0))
    codes = jnp.where(active, codes, 0.0)
    residual, total = residual - codes, total + codes
    books.append(vq.choose(active, book, before))
    indices.append(jnp.where(active, chosen, -1))
  # Parity: in the reference each level passes the gradient on, and so does the residual, so the encoder receives it
  # once per active level; gain_once is the textbook's straight-through estimator.
  gain = 1 if gain_once else num_active
  quantized = jax.lax.stop_gradient(total) + gain * (rows - jax.lax.stop_gradient(rows))
  result = Quantized(quantized.reshape(x.shape), jnp.stack(indices, -1).reshape(x.shape[:-1] + (num_levels,)),
                   *(sum(terms[1:], terms[0]) / num_active))
  return result, jax.tree.map(lambda *levels: jnp.stack(levels), *books)


def learn(codes: Float[Array, "q k c"], x: Float[Array, "b l c"], num_active: int | Int[Array, ""],
          axis_name: str | None = None) -> tuple[Quantized, Float[Array, ""]]:
  """Quantizes x (B, L, C) by the nearest of codes (Q, K, C), trained by gradients -> (Quantized, codebook loss ()).

  codebook: mean squared distance of the codes to the residuals that chose them, ||sg(z) - e||^2 of CDAMD's equation 10,
  as the commitment is ||z - sg(e)||^2; both means over active levels. Straight through once.
  """
  rows = x.reshape(-1, x.shape[-1])
  residual, total = rows, jnp.zeros_like(rows)
  still, indices, terms = jax.lax.stop_gradient, [], []
  for level, book in enumerate(codes):
    active = level < num_active
    chosen = vq.nearest(still(book), still(residual))
    vectors = book[chosen]
    _, counts = vq.usage_counts(chosen, len(book), x.dtype, axis_name)
    terms.append(jnp.where(active, jnp.stack([
        ((residual - still(vectors)) ** 2).mean(), vq.perplexity(counts), (counts > 0).mean(dtype=x.dtype),
        ((still(residual) - vectors) ** 2).mean()]), 0.0))
    vectors = jnp.where(active, still(vectors), 0.0)
    residual, total = residual - vectors, total + vectors
    indices.append(jnp.where(active, chosen, -1))
  *numbers, codebook = sum(terms[1:], terms[0]) / num_active
  quantized = (total + rows - still(rows)).reshape(x.shape)
  return Quantized(quantized, jnp.stack(indices, -1).reshape(x.shape[:-1] + (len(codes),)), *numbers), codebook


def first_codes(x: Float[Array, "b l c"], num_levels: int, num_codes: int, rng: Key[Array, ""]
                ) -> Float[Array, "{num_levels} {num_codes} c"]:
  """Initial codes (Q, K, C): the first rows of each level's residuals of x (B, L, C), as `train` initializes them."""
  residual, codes = x.reshape(-1, x.shape[-1]), []
  for key in jax.random.split(rng, num_levels):
    codes.append(vq.first_rows(residual, num_codes, jax.random.normal(key, (num_codes, x.shape[-1]))))
    residual = residual - codes[-1][vq.nearest(codes[-1], residual)]
  return jnp.stack(codes)


def encode(codes: Float[Array, "q k c"], x: Float[Array, "b l c"]
           ) -> tuple[Int[Array, "b l q"], Float[Array, "q b l c"]]:
  """Nearest codes, level by level: codes (Q, K, C), x (B, L, C) -> indices (B, L, Q), code vectors (Q, B, L, C)."""
  shapes.check(codes=(codes, "QKC"), x=(x, "BLC"))
  residual, indices, vectors = x.reshape(-1, x.shape[-1]), [], []
  for level in codes:
    chosen = vq.nearest(level, residual)
    indices.append(chosen)
    vectors.append(level[chosen])
    residual = residual - vectors[-1]
  return (jnp.stack(indices, -1).reshape(x.shape[:-1] + (len(codes),)),
          jnp.stack(vectors).reshape((len(codes),) + x.shape))


def decode(codes: Float[Array, "q k c"], indices: Int[Array, "b l q2"], num_levels: int | None = None
           ) -> Float[Array, "b l c"]:
  """Sum (B, L, C) of the code vectors of indices (B, L, Q), by default of all levels, else of the first num_levels.

  Index -1 adds nothing.
  """
  used = len(codes) if num_levels is None else num_levels
  if not 1 <= used <= min(len(codes), indices.shape[-1]):
    raise ValueError(f"got num_levels = {used} for {len(codes)} codebooks and indices of {indices.shape[-1]} levels; "
                     "expected at least 1 and at most as many as both")
  named = lambda level: jnp.where(indices[..., level, None] >= 0, codes[level][indices[..., level]], 0.0)
  return sum((named(level) for level in range(1, used)), named(0))
