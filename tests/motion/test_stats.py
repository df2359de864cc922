"""Statistics are by block, belong to one layout, and undo themselves."""
import numpy as np
import pytest

from motion_jax.motion.representations import LAYOUTS
from motion_jax.motion.stats import ABSOLUTE, Stats, biased_std, compute_stats, load_stats, save_stats


def _features(dim, seed=0):
  rng = np.random.default_rng(seed)
  return rng.normal(size=(50, dim)) * rng.uniform(0.1, 3, dim) + rng.normal(size=dim)


@pytest.mark.parametrize("name", LAYOUTS)
def test_std_is_one_number_per_block(name):
  layout, features = LAYOUTS[name], _features(LAYOUTS[name].dim)
  stats = compute_stats([features[:20], features[20:]], layout)
  assert np.allclose(stats.mean, features.mean(0), atol=1e-6)
  for block in layout.blocks.values():
    expected = features.std(0)[block]
    if layout.std_by_block:
      expected = np.full_like(expected, expected.mean())
    assert np.allclose(stats.std[block], expected, rtol=1e-6)


def test_files_of_coordinates_may_hold_three_numbers(tmp_path):
  for name, values in zip(ABSOLUTE, ([1, 2, 3], [4, 5, 6])):
    np.save(tmp_path / name, np.array(values, np.float64))
  stats = load_stats(tmp_path, "coordinates", ABSOLUTE)
  assert np.array_equal(stats.mean, np.tile([1, 2, 3], 22)) and np.array_equal(stats.std, np.tile([4, 5, 6], 22))
  np.save(tmp_path / ABSOLUTE[0], np.zeros(263))
  with pytest.raises(ValueError, match="another representation"):
    load_stats(tmp_path, "coordinates", ABSOLUTE)


def test_normalize_and_back(tmp_path):
  features = _features(263)
  stats = compute_stats(features, "full")
  save_stats(stats, tmp_path)
  loaded = load_stats(tmp_path)
  assert loaded.layout is LAYOUTS["full"] and loaded.fingerprint == stats.fingerprint
  assert np.allclose(loaded.denormalize(loaded.normalize(features)), features, atol=1e-5)


def test_a_column_that_never_moves_gets_std_1():
  features = _features(66)
  features[:, 3] = 2.0
  assert compute_stats(features, "coordinates").std[3] == 1


@pytest.mark.parametrize("columns, divided", [
    (263, [*range(4), *range(259, 263)]), (251, [*range(4), *range(247, 251)]), (67, range(4)), (64, range(4))])
def test_the_bias_divides_the_std_of_root_and_contacts_and_no_other(columns, divided):
  """MoMask's loaders divide by 5 twice (docs/papers/momask.md#statistics); fixture momask/statistics has both steps."""
  expected = np.ones(columns)
  expected[list(divided)] = 1 / 25
  np.testing.assert_allclose(biased_std(np.ones(columns), 25), expected)
  np.testing.assert_allclose(biased_std(biased_std(np.ones(columns))), expected)


def test_wrong_statistics_are_told(tmp_path):
  layout = LAYOUTS["full"]
  with pytest.raises(ValueError, match="another representation"):
    Stats(np.zeros(67), np.ones(67), layout)
  with pytest.raises(ValueError, match="NaN"):
    Stats(np.full(263, np.nan), np.ones(263), layout)
  with pytest.raises(ValueError, match="not positive"):
    Stats(np.zeros(263), np.zeros(263), layout)
  with pytest.raises(FileNotFoundError, match="Mean.npy"):
    load_stats(tmp_path)
