"""A codebook follows the vectors that choose it, exactly as far as the reference's does."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.quant import vq


def test_assignment():
  codes = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
  x = jnp.array([[0.4, 0.1], [0.6, 0.1], [0.1, 1.2]])
  assert vq.nearest(codes, x).tolist() == [0, 1, 2]
  assert np.allclose(vq.squared_distances(codes, x)[0], [0.17, 0.37, 0.16 + 3.61], atol=1e-6)
  noise = jax.random.gumbel(jax.random.key(0), (20_000, 3))
  shares = np.bincount(vq.sample(codes, jnp.tile(x[:1], (20_000, 1)), noise), minlength=3) / 20_000
  assert np.allclose(shares, jax.nn.softmax(-vq.squared_distances(codes, x)[0] / 0.5), atol=0.02)


@pytest.mark.parametrize("rows", [16, 37, 64])
def test_a_code_used_exactly_once_at_the_first_step_is_alive(rows):
  """0.99 + 0.01 is 1 in float32; compilers that contract or reorder may make it 0.99999994.

  Source: docs/papers/cdamd.md#rvq.
  """
  x = jax.random.normal(jax.random.key(rows), (rows, 5))

  @jax.jit
  def first_step(x):
    book = vq.initialise(vq.empty_codebook(rows, 5), x, jnp.zeros((rows, 5)))
    return vq.update(book, x, vq.nearest(book.codes, x), jnp.zeros((rows, 5)))

  book, counts = first_step(x)
  assert (counts == 1).all() and (vq.num_dead(book) == 0) and np.allclose(book.counts, 1, atol=1e-6)
  below = book._replace(counts=jnp.full(rows, np.nextafter(np.float32(1), np.float32(0))))
  assert vq.num_dead(below) == 0 and vq.num_dead(below._replace(counts=below.counts - 1e-6)) == rows


def test_dead_codes_take_rows_of_the_batch_and_keep_their_sums():
  x = jax.random.normal(jax.random.key(0), (12, 3))
  book = vq.codebook_of(jnp.zeros((8, 3)))
  after, counts = vq.update(book, x, jnp.zeros(12, int), jnp.zeros((8, 3)))
  assert counts.tolist() == [12] + [0] * 7 and vq.num_dead(after) == 7
  assert np.allclose(after.counts[0], 0.99 + 0.12) and np.allclose(after.counts[1:], 0.99)
  assert np.array_equal(after.codes[1:], x[1:8]) and np.allclose(after.codes[0], 0.01 * x.sum(0) / 1.11, atol=1e-6)
  assert not after.sums[1:].any()


def test_fewer_rows_than_codes_are_repeated_with_noise():
  x, noise = jax.random.normal(jax.random.key(0), (3, 4)), jax.random.normal(jax.random.key(1), (8, 4))
  rows = vq.first_rows(x, 8, noise)
  assert np.allclose(rows, np.tile(x, (3, 1))[:8] + 0.005 * noise, atol=1e-7)
  assert np.array_equal(vq.first_rows(x, 2, noise), x[:2])


def test_the_first_batch_initialises_once():
  x = jax.random.normal(jax.random.key(0), (9, 4))
  book = vq.initialise(vq.empty_codebook(5, 4), x, jnp.zeros((5, 4)))
  assert np.array_equal(book.codes, x[:5]) and book.initialised and (book.counts == 1).all()
  again = vq.initialise(book, -x, jnp.zeros((5, 4)))
  assert np.array_equal(again.codes, book.codes)


def test_perplexity_is_the_number_of_codes_in_even_use():
  assert np.allclose(vq.perplexity(jnp.array([5.0, 5, 5, 0])), 3, atol=1e-4)
