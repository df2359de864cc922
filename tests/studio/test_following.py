"""A shipped model follows paths that are not in its training data."""
import numpy as np
import pytest

import motion_jax
from motion_jax.control import paths
from motion_jax.control.signal import ControlSignal
from motion_jax.metrics.physics import skating_ratio
from motion_jax_studio import Pipeline

WORDS = ["a person walks", "a person walks forward"]


def _on(path):
  positions, given = np.zeros((2, len(path), 22, 3), np.float32), np.zeros((2, len(path), 22, 3), bool)
  positions[:, :, 0, ::2], given[:, :, 0, ::2] = path, True
  return ControlSignal(positions, given, np.zeros(given.shape[:2], np.float32), np.zeros(given.shape[:2], bool))


@pytest.mark.slow
def test_a_path_is_followed_when_known_more_when_guided_and_exactly_when_projected():
  model = motion_jax.load("cmdm-small")
  pipeline = Pipeline(model)
  path = paths.corner(model.fps, 2.4)
  off = lambda motions: np.linalg.norm([motion.joints[:, 0, ::2] - path for motion in motions], axis=-1)
  make = lambda **options: pipeline(WORDS, len(path), seeds=[1, 2], cleanup=False, plan=False, **options)
  plain, known = make(), make(control=_on(path), control_steps=0, exact=False)
  guided, exact = make(control=_on(path), exact=False), make(control=_on(path))
  assert off(known).mean() < 0.75 * off(plain).mean()
  assert off(guided).mean() < 0.05 and off(exact).max() < 1e-3
  skates = lambda motions: np.mean([skating_ratio(motion.joints) for motion in motions])
  assert skates(guided) < 0.5 and skates(known) < 0.5  # a sharp corner at 1.2 m/s takes a slide; walking has 0.1 to 0.2
