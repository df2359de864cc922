"""Kept frames stay to the bit; new ones begin and end where their neighbours are."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.blending import join


@pytest.fixture(scope="module")
def given():
  return synthetic_joints("walk", 80, np.random.default_rng(0)).astype(np.float32)


def kept_of(*spans):
  kept = np.zeros(80, bool)
  for first, past in spans:
    kept[first:past] = True
  return kept


@pytest.mark.parametrize("spans", [[(0, 40)], [(40, 80)], [(0, 20), (60, 80)], [(20, 60)], [(0, 39), (41, 80)]])
def test_kept_frames_are_kept_and_borders_have_no_jump(given, spans):
  """What was made is 0.2 m and a lean beside what was given; nothing of that is left at the borders."""
  made = given + np.array([0.2, 0.0, -0.1]) + 0.05 * np.arange(22)[:, None] / 22
  kept = kept_of(*spans)
  joined = join(made, given, kept)
  np.testing.assert_array_equal(joined[kept], given[kept])
  steps, real = np.diff(joined, axis=0), np.diff(given, axis=0)
  assert np.abs(steps - real).max() < 0.02, "a step of the pasted motion would be 0.2 m off"
  assert np.abs(joined - made)[~kept].max() < 0.3


def test_nothing_is_off_nothing_is_moved(given):
  np.testing.assert_allclose(join(given, given, kept_of((0, 30))), given, atol=1e-6)
  made = given + 1.0
  np.testing.assert_array_equal(join(made, given, kept_of()), made.astype(np.float32))


def test_a_way_that_leads_elsewhere_is_not_bent_back(given):
  """Behind a kept beginning the new path starts at its end and keeps its shape; its poses are its own in the end."""
  made = given + np.array([0.3, 0.0, 0.3])
  made[40:] += np.linspace(0, 1, 40)[:, None, None] * np.array([1.0, 0, 0])
  joined = join(made, given, kept_of((0, 40)))
  np.testing.assert_allclose(joined[60:] - made[60:], np.broadcast_to([-0.3, 0, -0.3], (20, 22, 3)), atol=1e-5)


def test_a_jump_at_the_border_is_taken_out(given):
  """A model that puts its new part a metre away from the kept one makes no metre's step."""
  made = given.copy()
  made[40:] += np.array([1.0, 0, 0.5])
  steps = np.diff(join(made, given, kept_of((0, 40))), axis=0)
  assert np.linalg.norm(steps - np.diff(given, axis=0), axis=-1).max() < 0.2


def test_speed_goes_on_across_a_border(given):
  """Kept frames move on, what the network makes of them and of what follows stands: the stop takes its time."""
  moving = given[:1] + 0.05 * np.arange(80)[:, None, None] * np.array([0.0, 0, 1])
  made = np.broadcast_to(moving[39], moving.shape)
  steps = np.diff(join(made, moving, kept_of((0, 40)))[:, 0, 2])
  assert abs(steps[39] - 0.05) < 0.01 and (np.diff(steps[39:55]) <= 1e-6).all() and abs(steps[60]) < 1e-6
