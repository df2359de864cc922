"""New frames continue kept ones: kept frames to the bit, the source's bones, no jump, feet that do not slide."""
import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.filling import fill_frames, in_spans
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

SPANS = [[(40, 80)], [(0, 40)], [(20, 60)], [(0, 20), (60, 80)], [(39, 41)], [(39, 40)]]


OWN = dataclasses.replace(HUMANML3D, bone_lengths=HUMANML3D.bone_lengths * 1.02)


@pytest.fixture(scope="module")
def given():
  joints = synthetic_joints("walk", 80, np.random.default_rng(0)).astype(np.float64)
  return with_lengths(gaussian_filter1d(joints, 2, axis=0), OWN)  # without steps that no body takes


def new_of(spans):
  new = np.zeros(80, bool)
  for first, past in spans:
    new[first:past] = True
  return new


def elsewhere(joints, angle=0.7, shift=(0.6, 0.0, -0.4)):
  """The same motion from another place, turned about y, whose bones stretch and shrink by a fifth."""
  c, s = np.cos(angle), np.sin(angle)
  turned = joints @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + shift
  breath = 1 + 0.2 * np.sin(np.arange(len(joints)) / 6)[:, None, None]
  return turned[:, :1] + (turned - turned[:, :1]) * breath


@pytest.mark.parametrize("spans", SPANS)
def test_kept_frames_stay_and_new_ones_have_their_bones(given, spans):
  new = new_of(spans)
  filled = fill_frames(elsewhere(given), given, new, OWN)
  np.testing.assert_array_equal(filled[~new], given[~new])
  assert np.abs(bone_lengths(filled, OWN) - OWN.bone_lengths).max() < 1e-6
  steps = np.linalg.norm(np.diff(filled, axis=0), axis=-1)
  assert steps.max() < np.linalg.norm(np.diff(given, axis=0), axis=-1).max() + 0.12, "a leap would be half a metre"


@pytest.mark.parametrize("spans", SPANS)
def test_the_same_motion_from_elsewhere_comes_back(given, spans):
  """Aligned rigidly at its borders it is what it was, but for the correction of feet."""
  turned = with_lengths(elsewhere(given), OWN)
  filled = fill_frames(turned, given, new_of(spans), OWN)
  assert np.abs(filled - given).max() < 0.05


def test_between_two_kept_parts_the_way_is_spread_over_steps(given):
  """The network's own motion ends 0.3 m and 20 degrees off: each step takes a part of it, none more than a few cm."""
  new, made = new_of([(20, 60)]), given.copy()
  for i, share in enumerate(np.clip((np.arange(80) - 20) / 40, 0, 1)):
    c, s = np.cos(0.35 * share), np.sin(0.35 * share)
    root = made[i, :1] * [1, 0, 1]
    made[i] = (made[i] - root) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + root + share * np.array([0.3, 0, 0])
  filled = fill_frames(made, given, new, OWN)
  root = np.diff(filled[:, 0, [0, 2]], axis=0)
  assert np.linalg.norm(root - np.diff(given[:, 0, [0, 2]], axis=0), axis=-1).max() < 0.03
  np.testing.assert_array_equal(filled[60:], given[60:])


def test_a_body_that_stops_does_not_go_back():
  """Kept frames move on, new ones stand: the speed fades, and the path never turns round."""
  stand = np.repeat(synthetic_joints("walk", 80, np.random.default_rng(0))[:1].astype(np.float64), 80, axis=0)
  moving = stand + 0.05 * np.arange(80)[:, None, None] * np.array([0.0, 0, 1])
  path = fill_frames(stand, moving, new_of([(40, 80)]), HUMANML3D, fix_body=False)[:, 0, 2]
  steps = np.diff(path)
  assert abs(steps[39] - 0.05) < 0.015 and (steps > -1e-9).all() and steps[60:].max() < 1e-9


def test_a_foot_stands_still_across_a_border():
  """Both parts stand, the new one 5 cm to the side: the body leans over, the feet stay where they were."""
  stand = np.repeat(synthetic_joints("walk", 80, np.random.default_rng(0))[:1].astype(np.float64), 80, axis=0)
  stand = with_lengths(stand, HUMANML3D)
  made = stand.copy()
  made[40:, :] += np.array([0.05, 0, 0]) * np.clip(stand[40:, :, 1:2], 0, 1)  # leans
  ankles = [7, 8]
  filled = fill_frames(made, stand, new_of([(40, 80)]), HUMANML3D)
  drift = lambda joints: np.linalg.norm((joints - stand)[:, ankles][..., [0, 2]], axis=-1).max()
  assert drift(filled) < 0.01


def test_nothing_is_new_and_everything_is():
  joints = synthetic_joints("walk", 80, np.random.default_rng(0)).astype(np.float64)
  np.testing.assert_array_equal(fill_frames(joints + 1, joints, np.zeros(80, bool)), joints)
  made = with_lengths(joints + 1, HUMANML3D)
  assert np.abs(fill_frames(made, joints, np.ones(80, bool)) - made).max() < 0.05


def test_spans_of_frames_lie_inside_of_the_motion():
  np.testing.assert_array_equal(in_spans([(0, 3), (70, 80)], 80), new_of([(0, 3), (70, 80)]))
  for span in ((3, 3), (70, 81), (-1, 3)):
    with pytest.raises(ValueError, match=f"span {span[0]}:{span[1]} of a motion of 80 frames"):
      in_spans([span], 80)
