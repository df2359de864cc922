"""The std of eight columns over 25, as MoMask and T2M-GPT know it, and the data set's own for all other methods."""
import numpy as np
import pytest

from motion_jax.data import sources
from motion_jax.motion.stats import biased_std
from motion_jax.utils import config_files
from tests.conftest import load_config


def test_eight_columns_of_the_std_are_divided_by_25_and_no_other():
  """MoMask's loaders divide by 5 twice (docs/papers/momask.md#statistics); fixture momask/statistics has both steps."""
  config = load_config("momask_rvq", "tiny").data.copy_and_resolve_references().unlock()
  plain = sources.load_features(config).stats
  config.feature_bias = 25.0
  biased = sources.load_features(config).stats
  divided = np.r_[0:4, 259:263]
  np.testing.assert_allclose(plain.std[divided] / biased.std[divided], 25, rtol=1e-6)
  rest = np.setdiff1d(np.arange(263), divided)
  np.testing.assert_array_equal(plain.std[rest], biased.std[rest])
  np.testing.assert_array_equal(plain.mean, biased.mean)
  given = sources.load_features(config, stats=plain).stats  # those of a run that is built upon stay
  np.testing.assert_array_equal(given.std, plain.std)
  np.testing.assert_allclose(biased_std(biased_std(plain.std)), biased.std, rtol=1e-6)


@pytest.mark.parametrize("columns, divided", [(263, 8), (251, 8), (67, 4), (64, 4)])
def test_columns_by_representation(columns, divided):
  assert (biased_std(np.ones(columns), 25) < 1).sum() == divided


def test_only_momask_and_t2m_gpt_divide():
  """CDAMD's and MARDM's loaders do not, for 263 and for 67 columns (docs/papers/momask.md#statistics)."""
  for name in config_files.names():
    if "/" in name:
      continue
    bias = load_config(name, "full").data.get("feature_bias", 0.0)
    reads_motion = name != "momask_length"  # that one reads words alone
    assert bias == (25.0 if name.startswith(("momask", "t2m_gpt")) and reads_motion else 0.0), name
  assert all(load_config("cdamd_generator", size).data.feature_bias == 0 for size in ("67", "263", "mardm_67"))
