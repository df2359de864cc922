"""Random keys made in numpy are those of JAX."""
import jax
import numpy as np
import pytest

from motion_jax.models.base import random_keys, select_keys
from motion_jax.utils.numerals import SEEDS


def test_keys_are_those_of_jax():
  seeds = [0, 1, 7, -1, 2**31 - 1, 2**31, -2**31, SEEDS[1], -SEEDS[1]]
  keys = random_keys(seeds)
  expected = np.stack([jax.random.key_data(jax.random.key(seed)) for seed in seeds])
  np.testing.assert_array_equal(jax.random.key_data(keys), expected)
  assert keys.dtype == jax.random.key(0).dtype
  np.testing.assert_array_equal(jax.random.key_data(select_keys(keys, [2, 0])), expected[[2, 0]])


@pytest.mark.parametrize("rows", [[1], [2, 0]])
def test_old_keys_are_selected(rows):
  keys = jax.random.split(jax.random.PRNGKey(3), 3)
  np.testing.assert_array_equal(select_keys(keys, rows), np.asarray(keys)[rows])
