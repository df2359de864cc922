"""Cleanup takes tremor and sliding away and leaves the motion."""
import warnings

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.cleanup import LOOK_AHEAD, Cleaner, clean_up
from motion_jax.motion.representations import extract
from motion_jax.motion.retarget import floor_height, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths


def _slide(joints, contacts):
  """Mean step of standing ankles over the ground, metres a frame."""
  steps = [np.linalg.norm(np.diff(joints[:, foot][:, [0, 2]], axis=0), axis=-1)[contacts[:-1, column] > 0.5]
           for column, foot in ((0, 7), (2, 8))]
  return np.concatenate(steps).mean()


@pytest.fixture(params=[0, 9], ids=["stand", "jump"])
def clip(request):
  joints = synthetic_clips(0, 11)[request.param].joints.astype(np.float64)
  contacts = extract(joints)[:, -4:]
  return joints[:-1], contacts


def test_a_clean_motion_stays_as_it_is(clip):
  joints, contacts = clip
  made = clean_up(joints, contacts)
  assert np.linalg.norm(made - joints, axis=-1).mean() < 0.01
  assert made.dtype == np.float32 and made.shape == joints.shape and clean_up(joints[:2]).shape == (2, 22, 3)


def test_tremor_and_sliding_go_and_bones_keep_their_length(clip):
  joints, contacts = clip
  rng = np.random.default_rng(0)
  drift = np.cumsum(rng.normal(0, 0.004, (len(joints), 1, 3)) * [1, 0, 1], axis=0)
  rough = joints + drift + rng.normal(0, 0.004, joints.shape)
  made = clean_up(rough, contacts)
  jerk = lambda x: np.abs(np.diff(x, 3, axis=0)).mean()
  assert jerk(made) < 0.5 * jerk(rough)
  assert _slide(made, contacts) < 0.5 * _slide(rough, contacts)
  assert np.abs(bone_lengths(made, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-3
  assert np.linalg.norm(made - rough, axis=-1).mean() < 0.03
  sunk, feet = joints - [0, 0.03, 0], [7, 8, 10, 11]
  assert clean_up(sunk, contacts)[:, feet, 1].min() > sunk[:, feet, 1].min() + 0.01, "feet in the floor come up"


def test_smoothing_is_a_choice(clip):
  """A steady hand keeps what it does at 0, tremor included; more smoothing leaves less of it."""
  joints, contacts = clip
  rough = joints + np.random.default_rng(0).normal(0, 0.002, joints.shape)
  arms = [20, 21]
  jerk = lambda x: np.abs(np.diff(x[:, arms] - x[:, :1], 3, axis=0)).mean()
  by = [jerk(clean_up(rough, contacts, smoothing=amount)) for amount in (0.0, 0.4, 0.7)]
  assert by[0] > 1.1 * by[1] > 1.2 * by[2]
  assert jerk(clean_up(rough, contacts)) == by[2]
  with warnings.catch_warnings(action="error"):  # of a damaged run folder
    np.testing.assert_array_equal(clean_up(rough, contacts, smoothing=1e-300), clean_up(rough, contacts, smoothing=0.0))


@pytest.mark.parametrize("told", [True, False], ids=["contacts", "joints alone"])
def test_pieces_are_cleaned_as_the_whole_is(clip, told):
  """Of any sizes; a frame is decided when the LOOK_AHEAD next ones are known, and does not change after."""
  joints, contacts = clip
  joints = joints + np.random.default_rng(0).normal(0, 0.004, joints.shape)
  whole = clean_up(joints, contacts if told else None)
  floor = 0.0 if told else float(floor_height(joints))
  cleaner, parts, start = Cleaner(floor=floor), [], 0
  for size in (12, 1, 2, 30, 5, len(joints)):
    piece = slice(start, start + size)
    parts.append(cleaner.push(joints[piece], contacts[piece] if told else None))
    start = min(start + size, len(joints))
    assert sum(map(len, parts)) == max(start - LOOK_AHEAD, 0)
  np.testing.assert_allclose(np.concatenate([*parts, cleaner.flush()]), whole, atol=1e-6)


@pytest.mark.parametrize("flies, left", [(0, 0.2), (3, 0.3)])
def test_a_body_that_its_feet_do_not_carry_goes_as_they_say(flies, left):
  """A walk whose root runs 0.8 m/s ahead of its legs: most of that is taken back, and none of an honest walk; also
  where feet are known to stand in five of eight frames only, as in a run."""
  joints = synthetic_clips(0, 2)[1].joints.astype(np.float64)
  joints, contacts = joints[:-1], extract(joints)[:, -4:]
  contacts = np.where((np.arange(len(joints)) % 8 >= 8 - flies)[:, None], 0, contacts)
  pushed = joints + (np.arange(len(joints)) * 0.8 / 20)[:, None, None] * [0, 0, 1]
  way = lambda x: x[-1, 0, 2] - x[0, 0, 2]
  assert way(joints) > 4 and abs(way(clean_up(joints, contacts)) - way(joints)) < 0.01 * way(joints)
  assert way(clean_up(pushed, contacts)) - way(joints) < left * (way(pushed) - way(joints))


def test_what_a_foot_is_held_back_by_does_not_pile_up():
  """Feet that stand and drift apart, 2 cm/s each for eight seconds: of these 16 cm they are 10 off at the most, and
  half as fast on the way."""
  standing = synthetic_clips(0, 1, num_frames=40)[0].joints[:1].repeat(220, axis=0).astype(np.float64)
  apart = np.clip(np.arange(220) - 30, 0, 160)[:, None] * [0.02 / 20]
  legs = [(1, 4, 7, 10), (2, 5, 8, 11)]
  for sign, leg in zip((1, -1), legs):
    standing[:, leg[1:], 0] += sign * apart * np.array([0.5, 1.0, 1.0])
  told = np.ones((220, 4))
  cleaned = clean_up(standing, told)
  off = np.linalg.norm((cleaned - with_lengths(standing, HUMANML3D))[:, [7, 8]][..., [0, 2]], axis=-1)
  assert off.max() < 0.1
  steps = lambda joints: np.abs(np.diff(joints[40:180, [7, 8], 0], axis=0)).mean() * 20
  assert steps(cleaned) < 0.6 * steps(with_lengths(standing, HUMANML3D))


def test_a_foot_that_swings_is_not_held_where_nobody_says_which_stand():
  """An honest walk stays as it is: no leg trails behind a body that goes on."""
  joints = synthetic_clips(0, 2)[1].joints.astype(np.float64)
  made = clean_up(joints).astype(np.float64)
  feet = list(HUMANML3D.left_feet + HUMANML3D.right_feet)
  beside = lambda x: (x - x[:, :1])[:, feet]
  assert np.linalg.norm(beside(made) - beside(joints), axis=-1).max() < 0.15
  assert np.linalg.norm(made[-1, 0] - joints[-1, 0]) < 0.05


def test_a_body_whose_bones_become_longer_rises_and_bends_no_knee(clip):
  joints, contacts = clip
  hips, knees, ankles = ([side[i] for side in ((1, 4, 7), (2, 5, 8))] for i in range(3))

  def bent(x):
    thigh, shin = x[:, hips] - x[:, knees], x[:, ankles] - x[:, knees]
    lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shin, axis=-1)
    return np.degrees(np.arccos((thigh * shin).sum(-1) / lengths))

  small = (0.92 * joints).astype(np.float64)
  made = clean_up(small, contacts).astype(np.float64)
  assert np.abs(bent(made) - bent(small)).mean() < 4
  assert made[:, 0, 1].mean() > 1.05 * small[:, 0, 1].mean()


def test_knees_do_not_snap(clip):
  """Feet that slide on nearly straight legs: planting them may not straighten the knees nor jerk them."""
  joints, contacts = clip
  slid = joints + np.sin(np.arange(len(joints)) / 4)[:, None, None] * [0.02, 0, 0.02]
  slid[:, :1] += [0, 0.02, 0]  # the pelvis is higher than the legs like it
  made = clean_up(slid, contacts).astype(np.float64)
  acceleration = lambda x: np.percentile(np.linalg.norm(np.diff(x[:, [4, 5]], 2, axis=0), axis=-1), 99) * 400
  assert acceleration(made) < 1.3 * max(acceleration(joints), acceleration(slid))
  made, own = (np.linalg.norm(x[:, [7, 8]] - x[:, [1, 2]], axis=-1).max() for x in (made, slid))
  assert made / HUMANML3D.bone_lengths[[4, 7]].sum() < max(0.9951, own / HUMANML3D.bone_lengths[[4, 7]].sum() + 1e-3)


def test_a_punch_keeps_its_speed():
  joints = synthetic_clips(0, 11)[7].joints[:60].astype(np.float64)
  away = np.exp(-0.5 * ((np.arange(60) - 30) / 1.2) ** 2)  # out and back in a quarter of a second
  for joint, share in ((18, 0.5), (20, 1.0)):
    joints[:, joint] += share * 0.25 * away[:, None] * [0, 0, 1]
  fastest = lambda x: np.linalg.norm(np.diff(x[:, 20] - x[:, 9], axis=0), axis=-1).max() * 20
  assert fastest(clean_up(joints)) > 0.95 * fastest(with_lengths(joints, HUMANML3D))
