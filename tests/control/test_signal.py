"""Constraints as arrays: errors of given coordinates alone, cut, stacked and empty."""
import jax
import numpy as np

from motion_jax.control import signal


def _path(batch=1, frames=4):
  """A pelvis target at x = 1 and z = 2, height free, in frame 1."""
  asked = jax.tree.map(np.array, signal.none(batch, frames))
  asked.positions[:, 1, 0], asked.given[:, 1, 0] = (1, 0, 2), (True, False, True)
  return asked


def test_errors_count_given_coordinates_alone():
  joints = np.full((1, 4, 22, 3), 5.0)
  found = np.asarray(signal.errors(_path(), joints))
  assert found[0, 1, 0] == 5.0  # of 4 and 3; y, which is 5 off 0, is not asked for
  assert found.sum() == 5.0


def test_errors_have_a_gradient_where_a_joint_is_in_its_place():
  slope = jax.grad(lambda joints: signal.errors(_path(), joints).sum())
  there = np.zeros((1, 4, 22, 3), np.float32)
  there[0, 1, 0] = (1, 0, 2)
  assert not np.asarray(slope(there)).any()
  there[0, 1, 0] = (4, 9, 6)
  np.testing.assert_allclose(np.asarray(slope(there))[0, 1, 0], (0.6, 0, 0.8), atol=1e-6)


def test_empty_cut_and_stacked():
  asked = _path()
  assert signal.none(2, 3).is_empty and not asked.is_empty
  assert asked.slice_frames(2, 4).is_empty and not asked.slice_frames(1, 2).is_empty
  longer = asked.slice_frames(1, 9)
  assert longer.frames == 8 and bool(longer.given[0, 0, 0, 0]) and int(longer.given.sum()) == 2
  assert asked.slice_frames(6, 9).frames == 3
  both = signal.stack([asked, signal.none(2, 6)])
  assert (both.batch, both.frames) == (3, 6) and int(both.given[0].sum()) == 2 and not bool(both.given[1:].any())
  facing = signal.none(1, 2).replace(heading_given=np.array([[True, False]]))
  assert not facing.is_empty
