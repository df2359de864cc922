"""A codebook follows the vectors that choose it, exactly as far as the reference's does."""
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.quant import vq

update = jax.jit(vq.update)


def rows(*size, seed=0):
  return np.random.default_rng(seed).normal(size=size).astype(np.float32)


def test_a_code_used_exactly_once_at_the_first_step_is_alive():
  """0.99 + 0.01 is 1 in float32; compilers that contract or reorder may make it 0.99999994.

  Source: docs/papers/cdamd.md#rvq.
  """
  x = rows(37, 5)

  @jax.jit
  def first_step(x):
    book = vq.initialise(vq.empty_codebook(37, 5), x, jnp.zeros((37, 5)))
    return vq.update(book, x, vq.nearest(book.codes, x), jnp.zeros((37, 5)))

  book, counts = first_step(x)
  num_dead = lambda counts: jax.jit(vq.num_dead)(book._replace(counts=counts))
  assert (np.asarray(counts) == 1).all() and num_dead(book.counts) == 0 and np.allclose(book.counts, 1, atol=1e-6)
  below = np.full(37, np.nextafter(np.float32(1), np.float32(0)))
  assert num_dead(below) == 0 and num_dead(below - np.float32(1e-6)) == 37


def test_dead_codes_take_rows_of_the_batch_and_keep_their_sums():
  x = rows(12, 3)
  after, counts = update(vq.codebook_of(np.zeros((8, 3), np.float32)), x, np.zeros(12, int), np.zeros((8, 3)))
  assert counts.tolist() == [12] + [0] * 7 and vq.num_dead(after) == 7
  assert np.allclose(after.counts[0], 0.99 + 0.12) and np.allclose(after.counts[1:], 0.99)
  assert np.array_equal(after.codes[1:], x[1:8]) and np.allclose(after.codes[0], 0.01 * x.sum(0) / 1.11, atol=1e-6)
  assert not np.asarray(after.sums)[1:].any()
