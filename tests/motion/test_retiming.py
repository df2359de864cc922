"""Another pace: what stands stays, what flies keeps its gravity, what is done takes so much longer."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.retarget import retarget
from motion_jax.motion.retiming import FLIGHT, aloft, retimed
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths


def _joints(action, count):
  return retarget(synthetic_joints(action, count, np.random.default_rng(0)))


@pytest.mark.parametrize("rate", [0.7, 1.0, 1.4])
def test_a_walk_at_another_pace(rate):
  joints = _joints("walk", 100)
  made = retimed(joints, rate)
  assert abs(len(made) - 99 / rate) < 2
  np.testing.assert_allclose(made[0], joints[0], atol=1e-4)
  np.testing.assert_allclose(bone_lengths(made, HUMANML3D)[:, 1:], bone_lengths(joints, HUMANML3D)[:1, 1:].repeat(
      len(made), 0), atol=1e-4)
  speed = lambda x: np.linalg.norm(x[-1, 0] - x[0, 0]) / len(x)
  np.testing.assert_allclose(speed(made), rate * speed(joints), rtol=0.03)
  for one in (joints, made):  # what stands, stands
    feet = one[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet)]
    step = np.linalg.norm(np.diff(feet, axis=0), axis=-1)[feet_stand(one)[1:] & feet_stand(one)[:-1]]
    assert np.median(step) < 0.15 / 20
  if rate == 1.0:
    np.testing.assert_allclose(made, joints, atol=1e-4)


def test_flights_keep_their_gravity():
  joints = np.repeat(_joints("stand", 60)[:1], 60, 0)
  time = np.arange(10) / 20
  joints[25:35, :, 1] += (np.clip(4.905 * time * (0.45 - time), 0, None))[:, None]
  for rate in (0.7, 1.4):
    made = retimed(joints, rate)
    flown = aloft(made).sum() / aloft(joints).sum()
    assert 1 / (1 + FLIGHT) - 0.13 < flown < 1 / (1 - FLIGHT) + 0.13
    assert abs(len(made) / 60 - 1 / rate) > 0.05
