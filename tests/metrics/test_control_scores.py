"""Numbers of control on motions whose distances are known, and the curves that are to be followed."""
import numpy as np
import pytest

from motion_jax.control.paths import CURVES
from motion_jax.metrics.control_scores import control_scores


def test_the_scores_of_known_distances():
  """Of four motions one is 0.3 m off at one of two points, another 0.6 m at its only one."""
  found = control_scores([np.array([0.0, 0.3]), np.array([0.6]), np.zeros(5), np.full(2, 0.1)])
  assert found == pytest.approx({"trajectory_20": 0.5, "trajectory_50": 0.25, "location_20": 0.2, "location_50": 0.1,
                                 "control_error": (0.15 + 0.6 + 0.1) / 4})
  with pytest.raises(ValueError, match="without a controlled frame"):
    control_scores([np.zeros(3), np.zeros(0)])


def test_curves_begin_ahead_and_a_circle_comes_back():
  """tests/control has their speed and their sides."""
  assert all(curve(20.0)[1, 1] > 0 for curve in CURVES.values())  # towards +Z
  places = CURVES["circle"](20.0)
  np.testing.assert_allclose(places[-1], 0, atol=0.1)
  assert np.ptp(places, axis=0) == pytest.approx([4, 4], abs=0.05)
