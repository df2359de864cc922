"""Features of bodies that turn all the way round, face backwards or raise their arms. The references' numbers are in
tests/test_golden.py."""
import numpy as np
import pytest

from motion_jax.motion import representations as F
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D

STANDING = HUMANML3D.offsets.copy()
for _joint in HUMANML3D.order[1:]:
  STANDING[_joint] += STANDING[HUMANML3D.parents[_joint]]

def test_corrected_mode_survives_a_full_turn_where_the_benchmark_does_not():
  angle = np.linspace(0, 2 * np.pi, 120)
  turning = rot.rotate(rot.about_axis(angle, "y")[:, None], STANDING[None])
  for mode, bound in (("corrected", 1e-5), ("benchmark", np.inf)):
    canonical = F.canonicalize(turning, mode=mode)
    error = np.abs(F.to_joints(F.to_features(turning, mode=mode)) - canonical[:-1]).max()
    assert error < bound
  assert error > 0.01  # the known fault of the benchmark's features


@pytest.mark.parametrize("mode", F.MODES)
def test_a_body_that_faces_exactly_backwards_or_raises_its_arms_has_features(mode):
  standing = STANDING.copy()
  expected = F.to_features(np.stack([standing] * 9), mode=mode)
  backwards = F.to_features(np.stack([standing * [-1, 1, -1]] * 9), mode=mode)
  assert np.abs(backwards - expected).max() < 1e-5
  standing[[18, 19, 20, 21], 1] = standing[16, 1] + [0.25, 0.25, 0.5, 0.5]  # opposite to the arms' rest direction
  raised = F.to_features(np.stack([standing] * 9), mode=mode)
  assert np.isfinite(raised).all()


@pytest.mark.parametrize("call, words", [
    (lambda: F.to_features(np.zeros((10, 21, 3))), "expected .*22"),
    (lambda: F.to_features(np.full((10, 22, 3), np.nan)), "NaN"),
    (lambda: F.to_features(np.zeros((1, 22, 3))), "at least 2 frames"),
    (lambda: F.to_features(np.zeros((10, 22, 3))), "no features in row 0"),
    (lambda: F.to_features(np.zeros((10, 22, 3)), mode="right"), "benchmark, corrected"),
    (lambda: F.to_joints(np.zeros((10, 67))), "67 features per frame.*263"),
])
def test_bad_input_is_told(call, words):
  with pytest.raises(ValueError, match=words):
    call()
