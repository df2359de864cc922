"""Motions that are joined meet without a jump, and no foot slides where it stands."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.motion.splicing import laid, landings, meeting, spliced, stepped

FEET = [*HUMANML3D.left_feet, *HUMANML3D.right_feet]


def _synthetic(action, frames=100, seed=0):
  return synthetic_joints(action, frames, np.random.default_rng(seed))


def _slide(joints):
  """Metres a second of joints of feet while they stand, on average."""
  stands = feet_stand(joints)
  steps = np.linalg.norm(np.diff(joints[:, FEET][..., [0, 2]], axis=0), axis=-1) * 20
  return steps[stands[1:] & stands[:-1]].mean()


def _swiftest(joints):
  """Metres a second squared, of any joint."""
  return np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1).max() * 400


def test_a_turned_and_moved_motion_is_laid_back_onto_itself():
  first = _synthetic("walk")[20:27]
  turned = np.stack([first[..., 2] + 3, first[..., 1], 1 - first[..., 0]], -1)
  found = meeting(first, turned)
  assert found.distance < 1e-9 and abs(abs(found.yaw) - np.pi / 2) < 1e-9
  np.testing.assert_allclose(laid(turned, found), first, atol=1e-9)
  assert meeting(first, _synthetic("squat")[40:47]).distance > 0.05


def test_standing_feet_keep_their_place_where_motions_are_joined():
  wave, squat = _synthetic("wave_left"), _synthetic("squat", seed=1)
  wide = squat.copy()
  for foot, shift in zip(((4, 7, 10), (5, 8, 11)), (0.03, -0.03)):
    wide[:, foot, 0] += shift
  joined = spliced(wave, 95, wide, 4)
  assert joined.shape == (96 + 95, 22, 3)
  np.testing.assert_array_equal(joined[:96], wave[:96])
  assert _slide(joined) < 0.02 and _slide(joined[94:108]) < 1e-6
  assert _swiftest(joined[90:110]) < 1.3 * max(map(_swiftest, (wave, squat)))
  np.testing.assert_allclose(bone_lengths(joined[100:], HUMANML3D)[:, 1:], np.broadcast_to(
      HUMANML3D.bone_lengths[1:], (91, 21)), atol=2e-3)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_walk_comes_to_rest_by_a_step_and_begins_by_one(backwards):
  walk, stand = _synthetic("walk", 120), _synthetic("stand")
  if backwards:
    walk = walk[::-1]
  frame, side = next(at for at in landings(walk) if at[0] > 40)
  joined = stepped(walk, frame, stand, 10, side)
  assert len(joined) == frame + 1 + 89 and _slide(joined) < 1.2 * _slide(walk) + 0.01
  assert _swiftest(joined) < 1.5 * _swiftest(walk)
  rest = joined[frame + 20:]
  assert np.ptp(rest[:, 0], axis=0).max() < 0.03  # the body stays where it stopped
  ahead = (walk[frame, 0] - walk[frame - 1, 0])[[0, 2]]
  gone = (joined[frame:, 0][:, [0, 2]] - walk[frame, 0, [0, 2]]) @ (ahead / np.linalg.norm(ahead))
  assert gone.max() - gone[-1] < 0.05  # and did not go too far and come back
