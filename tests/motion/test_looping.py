"""A loop's end is its beginning, in place and speed; a motion held in its place is the same motion."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.looping import in_place, looped
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths, facing


@pytest.fixture(scope="module")
def walk():
  return synthetic_joints("walk", 50, np.random.default_rng(0)).astype(np.float64)


def own(joints):
  """Joints as the body sees them: from over the ground below its root, turned to where it faces."""
  ahead = facing(joints, HUMANML3D)
  angle = np.arctan2(ahead[:, 0], ahead[:, 2])
  body = joints - joints[:, :1] * [1, 0, 1]
  c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
  return np.stack([c * body[..., 0] - s * body[..., 2], body[..., 1], s * body[..., 0] + c * body[..., 2]], -1)


def test_the_end_meets_the_beginning(walk):
  made = looped(walk[:43], 20.0).astype(np.float64)  # in the midst of a step
  assert made.shape == (43, 22, 3)
  body, given = own(made), own(walk[:43])
  assert np.abs(given[-1] - given[0]).max() > 0.1
  assert np.abs(body[-1] - body[0]).max() < 0.02
  speed = lambda x: np.abs((x[-1] - x[-2]) - (x[1] - x[0])).max()
  assert speed(body) < 0.3 * speed(given)
  assert np.abs(bone_lengths(made, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-5
  # No frame jumps: steps of joints are no larger than the walk's own and what is faded in over half a second.
  assert np.abs(np.diff(made, axis=0)).max() < np.abs(np.diff(walk, axis=0)).max() + 0.08
  # It goes as far as the walk does.
  gone = lambda x: np.linalg.norm((x[-1] - x[0])[0, [0, 2]])
  assert abs(gone(made) - gone(walk[:43])) < 0.15 * gone(walk[:43]) + 0.05


def test_a_loop_is_the_same_wherever_the_body_faces(walk):
  turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
  assert np.abs(looped(walk @ turn.T + [30, 0, -20]) - (looped(walk) @ turn.T + [30, 0, -20])).max() < 1e-4


def test_what_is_a_loop_already_stays():
  t = np.arange(41) / 40 * 2 * np.pi
  still = synthetic_joints("walk", 50, np.random.default_rng(0))[:1].astype(np.float64)
  sway = np.repeat(still, 41, axis=0)
  sway[:, :, 1] += 0.01 * np.sin(t)[:, None]
  assert np.abs(looped(sway) - sway).max() < 1e-3


def test_three_frames_are_no_loop(walk):
  with pytest.raises(ValueError, match="got 3 frames"):
    looped(walk[:3])


def test_in_place_takes_the_way_and_nothing_else(walk):
  made = in_place(walk)
  assert np.abs(made[:, 0, [0, 2]] - made[0, 0, [0, 2]]).max() < 1e-6
  assert np.abs((made - made[:, :1]) - (walk - walk[:, :1])).max() < 1e-5
  assert np.abs(made[..., 1] - walk[..., 1]).max() < 1e-6
