"""An arm that a network draws through the shoulder turns round over several frames, and nothing else changes."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.cleanup import Cleaner, clean_up
from motion_jax.motion.skeleton import HUMANML3D

SHOULDER, ELBOW, WRIST = 16, 18, 20  # left


def _flipping(around=30.2, steps=5):
  """A walk whose left arm goes to the opposite way straight through the shoulder, as the mean of both ways does."""
  joints = synthetic_clips(0, 1, num_frames=80)[0].joints.astype(np.float64)
  share = np.clip((np.arange(len(joints)) - around) / steps + 0.5, 0, 1)[:, None]
  arm = joints[:, [ELBOW, WRIST]] - joints[:, [SHOULDER]]
  joints[:, [ELBOW, WRIST]] = joints[:, [SHOULDER]] + arm * (1 - 2 * share)[:, None]
  return joints


def _turns(joints):
  """Degrees (T - 1,) that the left upper arm turns by from frame to frame."""
  bone = joints[:, ELBOW] - joints[:, SHOULDER]
  bone = bone / np.linalg.norm(bone, axis=-1, keepdims=True)
  return np.degrees(np.arccos(np.clip((bone[1:] * bone[:-1]).sum(-1), -1, 1)))


@pytest.mark.parametrize("steps", [3, 5, 8])
def test_a_limb_that_is_drawn_through_its_joint_does_not_flip(steps):
  made = clean_up(_flipping(steps=steps))
  step = np.linalg.norm(np.diff(made[:, ELBOW] - made[:, SHOULDER], axis=0), axis=-1)
  assert _turns(_flipping(steps=steps)).max() > 170  # one frame, 0.5 m of the elbow
  assert _turns(made).max() < 45 and step.max() < 0.2
  length = np.linalg.norm(made[:, ELBOW] - made[:, SHOULDER], axis=-1)
  assert np.abs(length - HUMANML3D.bone_lengths[ELBOW]).max() < 1e-3
  assert (_turns(made)[:22] < 15).all() and (_turns(made)[44:] < 15).all()


def test_an_arm_that_has_its_length_turns_as_fast_as_it_does():
  sure = synthetic_clips(0, 1, num_frames=80)[0].joints.astype(np.float64)
  others = [joint for joint in range(22) if joint not in (ELBOW, WRIST)]
  plain = clean_up(sure)
  sure[40:, [ELBOW, WRIST]] = 2 * sure[40:, [SHOULDER]] - sure[40:, [ELBOW, WRIST]]  # within one frame
  made = clean_up(sure)
  assert _turns(made).max() > 90
  np.testing.assert_allclose(made[:, others], plain[:, others], atol=1e-6)


@pytest.mark.parametrize("piece", [1, 7])
def test_pieces_are_steadied_as_the_whole_is(piece):
  joints, cleaner = _flipping(), Cleaner(floor=0.0)
  contacts = np.ones((len(joints), 4))
  parts = [cleaner.push(joints[at:at + piece], contacts[at:at + piece]) for at in range(0, len(joints), piece)]
  np.testing.assert_allclose(np.concatenate([*parts, cleaner.flush()]), clean_up(joints, contacts), atol=1e-6)
