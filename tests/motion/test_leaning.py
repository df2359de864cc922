"""Trunks lean by what is said; legs stay, and bones keep their lengths."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

WALK = retarget(synthetic_joints("walk", 20, np.random.default_rng(1)))


@pytest.mark.parametrize("left, ahead", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_trunk_leans_by_what_is_said_and_legs_stay(left, ahead):
  stands = np.repeat(WALK[:1], 10, axis=0)
  made = lean(stands, left, ahead, np.linspace(0, 20, 10))
  legs = [joint for chain in HUMANML3D.chains[:2] for joint in chain]
  np.testing.assert_allclose(made[:, legs], stands[:, legs], atol=1e-5)
  np.testing.assert_allclose(bone_lengths(made.astype(np.float64), HUMANML3D), bone_lengths(stands, HUMANML3D),
                             atol=1e-5)
  more = leans(made, left, ahead) - leans(stands, left, ahead)
  assert more[0] == pytest.approx(0, abs=1e-3) and 12 < more[-1] < 21 and (np.diff(more) > 0).all()
