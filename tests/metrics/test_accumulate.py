"""Chunks that pass by tell what all rows together would."""
import numpy as np
import pytest

from motion_jax.metrics import accumulate, scores


def _pass(chunks, size=50, seed=1):
  rng, passed = np.random.default_rng(seed), accumulate.start(size)
  for chunk in chunks:
    passed = accumulate.add(passed, chunk, rng)
  return passed


def test_chunks_do_not_matter():
  rows = np.random.default_rng(0).normal(2, 3, (400, 8))
  whole, parts = _pass([rows]), _pass([rows[:7], rows[7:8], rows[8:300], rows[300:]])
  np.testing.assert_array_equal(whole.rows, parts.rows)
  assert accumulate.diversity(whole) == accumulate.diversity(parts)
  other = np.random.default_rng(5).normal(size=(300, 8))
  assert scores.fid(parts.moments, scores.moments(other)) == pytest.approx(scores.fid(rows, other), rel=1e-9)


def test_a_draw_is_without_replacement_and_fair():
  rows = np.arange(40.0)[:, None]
  counts = np.zeros(40)
  for seed in range(400):
    first, second = _pass([rows[:15], rows[15:]], size=10, seed=seed).rows[..., 0]
    assert len(set(first)) == len(set(second)) == 10
    counts[first.astype(int)] += 1
  # each row is in a quarter of 400 draws: 100, with a standard deviation of 8.7
  assert abs(counts - 100).max() < 5 * 8.7
  assert accumulate.diversity(_pass([rows], size=40)) == pytest.approx(40 / 3, abs=3)  # E |a - b| of uniform a, b


def test_bad_chunks():
  passed = _pass([np.zeros((3, 4))])
  with pytest.raises(ValueError, match="embeddings of 5 numbers after others of 4"):
    accumulate.add(passed, np.zeros((2, 5)), np.random.default_rng())
  with pytest.raises(ValueError, match="row 1 of the embeddings holds NaN"):
    accumulate.add(passed, np.array([[0.0] * 4, [np.nan] * 4]), np.random.default_rng())
  with pytest.raises(ValueError, match="a draw of 30 rows, 3 were kept"):
    accumulate.diversity(passed, 30)
