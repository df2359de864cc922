"""A loop's end is its beginning, in place and speed; a motion held in its place is the same motion."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.looping import in_place, is_loop, looped, rounds, turn_of_round, velocity
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


def test_a_body_that_stands_ends_where_it_began_and_a_walk_goes_straight(walk):
  """Else it hops at each round, or runs in a circle; what turns more than 20 degrees keeps its curve."""
  angle = np.linspace(0, 0.2, 40)[:, None]
  c, s, still = np.cos(angle), np.sin(angle), np.repeat(walk[:1], 40, axis=0)
  bend = lambda x: np.stack([c * x[..., 0] + s * x[..., 2], x[..., 1], c * x[..., 2] - s * x[..., 0]], -1)
  idle = bend(still) + np.linspace(0, 0.08, 40)[:, None, None] * [1, 0, 0]
  made = looped(idle)
  assert np.abs(idle[-1] - idle[0]).max() > 0.05 and np.abs(made[-1] - made[0]).max() < 1e-5
  for times, straight in ((1, True), (4, False)):
    curve = walk[:40]
    for _ in range(times):
      curve = bend(curve)
    assert (abs(turn_of_round(looped(curve))) < 1e-6) == straight


def test_the_round_before_and_the_round_after_continue_a_loop(walk):
  made = looped(walk[:43]).astype(np.float64)
  wide = rounds(made, 30, turn_of_round(made))
  assert wide.shape == (103, 22, 3) and is_loop(made) and not is_loop(made[:30])
  np.testing.assert_array_equal(wide[30:73], made)
  step = np.linalg.norm(np.diff(wide, axis=0), axis=-1).max(1)
  assert step[[28, 29, 30, 71, 72, 73]].max() < step[32:70].max() * 1.2


def test_a_velocity_is_that_seen_from_the_body(walk):
  turn = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
  ahead = (walk[-1, 0] - walk[0, 0])[2] / (49 / 20)
  np.testing.assert_allclose(velocity(walk @ turn.T, 20.0), [0, 0, ahead], atol=0.03)


def test_three_frames_are_no_loop(walk):
  with pytest.raises(ValueError, match="got 3 frames"):
    looped(walk[:3])


def test_in_place_takes_the_way_and_nothing_else(walk):
  made = in_place(walk + [0.7, 0, 1])
  assert np.abs(made[:, 0, [0, 2]]).max() < 1e-6
  assert np.abs((made - made[:, :1]) - (walk - walk[:, :1])).max() < 1e-5
  assert np.abs(made[..., 1] - walk[..., 1]).max() < 1e-6
