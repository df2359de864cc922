"""Cleanup takes tremor and sliding away and leaves the motion."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.representations import extract
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths


def _slide(joints, contacts):
  """Mean step of standing ankles over the ground, metres a frame."""
  steps = [np.linalg.norm(np.diff(joints[:, foot][:, [0, 2]], axis=0), axis=-1)[contacts[:-1, column] > 0.5]
           for column, foot in ((0, 7), (2, 8))]
  return np.concatenate(steps).mean()


@pytest.fixture(params=[0, 7, 9], ids=["walk", "wave", "jump"])
def clip(request):
  joints = synthetic_clips(0, 11)[request.param].joints.astype(np.float64)
  contacts = extract(joints)[:, -4:]
  return joints[:-1], contacts


def test_a_clean_motion_stays_as_it_is(clip):
  joints, contacts = clip
  made = clean_up(joints, contacts)
  assert np.linalg.norm(made - joints, axis=-1).mean() < 0.01
  assert made.dtype == np.float32 and made.shape == joints.shape


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


def test_feet_in_the_floor_come_up(clip):
  joints, contacts = clip
  sunk = joints - [0, 0.03, 0]
  feet = [7, 8, 10, 11]
  assert clean_up(sunk, contacts)[:, feet, 1].min() > sunk[:, feet, 1].min() + 0.01


def test_short_clips_and_no_contacts():
  joints = synthetic_clips(0, 1)[0].joints
  assert clean_up(joints[:2]).shape == (2, 22, 3)
  assert np.isfinite(clean_up(joints)).all()
