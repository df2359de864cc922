"""Motions that were made apart become one: where they meet, or by the step that ends or begins a walk."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.metrics.physics import planted_speed
from motion_jax.motion.splicing import REACH
from motion_jax_studio.planning.joining import SLACK, joined

FRAMES = 60


def made(action, seed=0, frames=FRAMES + SLACK):
  return synthetic_joints(action, frames, np.random.default_rng(seed))


@pytest.mark.parametrize("actions", [
    ("wave_left", "walk"), ("walk", "wave_left", "walk"), ("turn_left", "walk")])
def test_parts_follow_one_another_for_as_long_as_asked_and_without_a_jump(actions):
  parts = [made(action, seed) for seed, action in enumerate(actions)]
  ends = [FRAMES * (i + 1) for i in range(len(parts))]
  joints, past = joined(parts, ends)
  assert len(joints) == ends[-1] == past[-1]
  assert all(abs(found - asked) <= 14 for found, asked in zip(past, ends))
  np.testing.assert_allclose(joints[:past[0] - 24], parts[0][:past[0] - 24], atol=1e-6)  # the first stays where it was
  fastest = max(np.linalg.norm(np.diff(part, axis=0), axis=-1).max() for part in parts)
  assert np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() < fastest + 0.2  # metres a frame: a step, no jump


def test_a_body_that_stands_begins_a_walk_in_full_stride_with_a_step():
  squat, walk = made("squat"), made("walk", 1, FRAMES + SLACK + 10)[10:]
  walk = walk[..., [2, 1, 0]] * [1, 1, -1] + [3, 0, 1]  # somewhere else, and to another side
  joints, past = joined([squat, walk], [FRAMES, 2 * FRAMES])
  assert past == [FRAMES, 2 * FRAMES]
  np.testing.assert_allclose(joints[:30], squat[:30], atol=1e-3)  # it stays where it was, the walk is laid
  assert planted_speed(joints[45:90]) < 0.005  # metres a second; spliced where poses are nearest: 0.016
  fastest = np.linalg.norm(np.diff(walk, axis=0), axis=-1).max()
  assert np.linalg.norm(np.diff(joints, axis=0), axis=-1).max() < fastest + 0.01


def test_what_is_too_short_is_refused():
  with pytest.raises(ValueError, match=f"expected {2 * REACH + 2} or more"):
    joined([made("walk"), made("walk", frames=5)], [FRAMES, 2 * FRAMES])
