"""Filters over time are those of scipy, which `generate` has no time to import."""
import numpy as np
import pytest
import scipy.ndimage
import scipy.signal

from motion_jax.motion import smoothing


@pytest.mark.parametrize("mode", ["reflect", "nearest", "constant"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_gaussian_filter_is_that_of_scipy(mode, dtype):
  rng = np.random.default_rng(0)
  for length in (1, 2, 7, 60):
    for shape, axis in (((length,), -1), ((length, 3), 0), ((2, length, 3), -2)):
      values = rng.normal(size=shape).astype(dtype)
      for sigma in (0.3, 1.0, 6.4):
        ours, theirs = (fn(values, sigma, axis=axis, mode=mode) for fn in (
            smoothing.gaussian_filter1d, scipy.ndimage.gaussian_filter1d))
        assert ours.dtype == dtype
        # scipy may be compiled with fused multiplications, as on arm64.
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-15 if dtype == np.float64 else 1e-7)


def test_peaks_are_those_of_scipy():
  rng = np.random.default_rng(1)
  for number in range(500):
    values = rng.normal(size=rng.integers(1, 60)) if number % 2 else rng.integers(0, 5, rng.integers(1, 60)) * 1.0
    height, distance, prominence = ([None, 0.5][rng.integers(2)], int(rng.integers(1, 9)), [0.0, 0.3][rng.integers(2)])
    expected = scipy.signal.find_peaks(values, height=height, distance=distance, prominence=prominence or None)[0]
    np.testing.assert_array_equal(smoothing.find_peaks(values, height, distance, prominence), expected)
