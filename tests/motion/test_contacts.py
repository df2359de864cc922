"""Which feet stand: slowly moving and low, the same at every rate; a foot that slides does not."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.contacts import feet_stand, majority, velocity
from motion_jax.motion.representations import to_features
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D


def _standing(frames=60):
  return synthetic_joints("stand", frames, np.random.default_rng(0))


def test_a_foot_that_slides_stands_for_the_benchmark_only():
  joints = _standing()
  joints[..., 2] -= (np.arange(len(joints)) * 0.6 / 20)[:, None]  # 0.6 m/s backward
  assert not feet_stand(joints).any()
  assert to_features(joints.astype(np.float32))[:, -4:].mean() > 0.9  # HumanML3D's rule takes it to stand


def test_a_foot_held_up_does_not_stand():
  joints = _standing()
  assert feet_stand(joints).all()
  left = list(HUMANML3D.left_feet)
  joints[:, left, 1] += 0.15
  stands = feet_stand(joints)
  assert not stands[:, :2].any() and stands[:, 2:].all()
  assert feet_stand(joints, floor=0.12).all()  # near a step of that height


@pytest.mark.parametrize("fps", [30, 60, 120])
def test_it_is_the_same_at_every_rate(fps):
  joints = synthetic_joints("walk", 100, np.random.default_rng(1))
  expected = feet_stand(joints)
  other = feet_stand(resample(joints, 20.0, fps), fps)
  at = np.minimum((np.arange(len(expected)) * fps / 20).round().astype(int), len(other) - 1)
  assert (other[at] == expected).mean() > 0.96  # borders may shift by part of a frame


def test_velocity_is_exact_on_a_line_and_at_the_ends():
  line = np.arange(10)[:, None] / 30 * [1.0, 0.0, -2.0]
  np.testing.assert_allclose(velocity(line, 30.0), np.broadcast_to([1.0, 0.0, -2.0], (10, 3)), atol=1e-12)


def test_a_velocity_is_taken_over_a_tenth_of_a_second_around_its_frame():
  pulse = np.zeros((60, 1))
  pulse[30] = 0.5
  found = velocity(pulse, 60.0)[:, 0]
  assert np.flatnonzero(found).tolist() == [27, 33]
  np.testing.assert_allclose(found[[27, 33]], [5, -5])


@pytest.mark.parametrize("fps, half", [(20.0, 3), (30.0, 4), (60.0, 8)])
def test_majority_is_of_a_quarter_of_a_second_around_each_frame(fps, half):
  """What lasts for half of it is gone, what lasts for a frame more stays where it was; so do gaps. The first and the
  last frame go on beyond the ends."""
  flags = np.zeros((80, 2), bool)
  flags[20:20 + half, 0] = flags[50:51 + half, 0] = flags[:2, 0] = flags[79:, 0] = True
  flags[:, 1] = ~flags[:, 0]
  made = majority(flags, fps)
  assert np.flatnonzero(made[:, 0]).tolist() == [0, 1, *range(50, 51 + half), 79]
  np.testing.assert_array_equal(made[:, 1], ~made[:, 0])
