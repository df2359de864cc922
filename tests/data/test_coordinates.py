"""Absolute coordinates as training sees them: 66 or 63 columns, statistics per column or per axis."""
import ml_collections
import numpy as np
import pytest

from motion_jax.data import sources
from motion_jax.motion.representations import to_joints


def _data(**fields):
  config = dict(name="synthetic", num_clips=4, layout="coordinates", mode="corrected") | fields
  return sources.load_features(ml_collections.ConfigDict(config))


@pytest.mark.parametrize("per_axis", [False, True])
def test_statistics_are_per_column_or_per_axis(per_axis):
  data = _data(per_axis=per_axis)
  frames = np.concatenate(data.features)
  if per_axis:
    assert np.array_equal(data.stats.std, np.tile(data.stats.std[:3], 22))
    frames = frames.reshape(-1, 3)
  else:
    assert len(np.unique(data.stats.std)) > 60
  assert np.abs(frames.mean(0)).max() < 1e-4 and np.abs(frames.std(0) - 1).max() < 1e-4


def test_coordinates_are_the_joints_that_full_features_mean():
  coordinates, full = _data(), _data(layout="full")
  for a, b in zip(coordinates.features, full.features, strict=True):
    joints = [to_joints(data.stats.denormalize(x), data.layout) for data, x in ((coordinates, a), (full, b))]
    assert joints[0].shape == (len(a), 22, 3) and np.abs(joints[0] - joints[1]).max() < 1e-4
    assert np.abs(joints[0][0, 0, [0, 2]]).max() < 1e-5  # the root begins at the origin, and nothing is re-centred


def test_kit_has_63_columns_in_millimetres():
  data = _data(layout="coordinates_kit")
  assert data.features[0].shape[-1] == 63 and data.stats.mean[1] > 300
