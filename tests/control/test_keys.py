"""Keys: slack in time, strength, and spans that meet them between frames that stay equal bit for bit."""
import re

import numpy as np
import pytest

from motion_jax.control import EffectorTarget, Keyframe, Loop, from_json, to_json
from motion_jax.control.keys import without_slack
from motion_jax.control.spans import missed, near_keys, project_frames
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.utils.errors import InputError

HAND = 20


@pytest.fixture(scope="module")
def walk():
  return synthetic_joints("walk", 60, np.random.default_rng(0)).astype(np.float32)


def _new(first, past, count=60):
  return (np.arange(count) >= first) & (np.arange(count) < past)


def test_a_key_with_slack_is_at_the_frame_where_the_motion_is_nearest(walk):
  where = walk[33, HAND]
  key = EffectorTarget("left_hand", [1.5], [where], slack=0.2)
  met, = without_slack([key], walk)
  assert met.times[0] == pytest.approx(33 / 20) and met.slack == 0
  late, = without_slack([key], walk, new=_new(20, 33))
  assert late.times[0] < 33 / 20
  _, moved = without_slack([EffectorTarget("left_hand", [33 / 20], [where]), key], walk)  # which has that frame
  assert 0 < abs(moved.times[0] * 20 - 33) <= 7
  pose, = without_slack([Keyframe(walk[42], 2.0, "world", slack=0.15)], walk)
  assert pose.time == pytest.approx(2.1)


def test_strength_is_a_share_of_the_way(walk):
  aim = walk[30, HAND] + [0, 0.2, 0]
  key, = without_slack([EffectorTarget("left_hand", [1.5], [aim], strength=0.25)], walk)
  assert np.allclose(key.positions[0], walk[30, HAND] + [0, 0.05, 0], atol=1e-6)
  pose, = without_slack([Keyframe(walk[10] + [0, 0, 1], 1.5, "world", strength=0.5)], walk)
  assert np.allclose(bone_lengths(pose.joints, HUMANML3D), bone_lengths(walk[10], HUMANML3D), atol=1e-5)
  assert pose.joints[0, 2] == pytest.approx((walk[10, 0, 2] + 1 + walk[30, 0, 2]) / 2, abs=1e-5)


@pytest.mark.parametrize("key", [
    lambda walk: EffectorTarget("left_hand", [1.5], [walk[30, HAND] + np.float32([0.05, 0.3, 0.1])]),
    lambda walk: Keyframe(walk[20] - walk[20, 0] * [1, 0, 1] + walk[30, 0] * [1, 0, 1], 1.5, "world")])
def test_a_span_meets_its_keys_and_other_frames_are_equal(walk, key):
  new, key = _new(20, 42), key(walk)
  made = project_frames(walk, [key], new)
  assert (made[~new] == walk[~new]).all() and not (made[new] == walk[new]).all()
  aims, joints = (key.positions, [HAND]) if isinstance(key, EffectorTarget) else (key.joints, range(22))
  assert np.abs(made[30, list(joints)] - aims).max() < 1e-3
  lengths = bone_lengths(walk, HUMANML3D)[:, 1:]
  assert np.abs(bone_lengths(made, HUMANML3D)[:, 1:] / lengths - 1).max() < 1e-3
  assert np.flatnonzero(near_keys([key], 60, 20.0, 2)).tolist() == [28, 29, 30, 31, 32]


def test_a_key_that_no_body_reaches_says_why_and_what_slack_would_do(walk):
  new, far = _new(26, 40), walk[30, 10] + np.float32([0, 0, 3])
  key = EffectorTarget("left_foot", [1.5], [far])
  made = project_frames(walk, [key], new)
  note, = missed(made, [key], walk, new)
  assert note.startswith("the key of left foot at 1.50 s (frame 30) cannot be met: it is ") and "m in 0.25 s" in note
  slack = int(re.search(r"a slack of (\d+) frames", note)[1])
  assert 0 < slack < 10 and np.isfinite(made).all() and (made[~new] == walk[~new]).all()
  loose = EffectorTarget("left_foot", [1.5], [walk[30, 10] + np.float32([0, 0, 1.2])], slack=0.3)
  assert not missed(project_frames(walk, [loose], _new(10, 50)), [loose], walk, _new(10, 50))


@pytest.mark.parametrize("constraint, words", [
    (EffectorTarget("left_hand", [2.5], [[0, 1, 0]]), "left hand at 2.50 s (frame 50), which is not among the frames"),
    (EffectorTarget("left_hand", [9.0], [[0, 1, 0]]), "left hand at 9.00 s"),
    (Loop(), "got a loop without times in an edit")])
def test_a_key_outside_the_span_is_refused(walk, constraint, words):
  with pytest.raises(InputError, match=words.replace("(", r"\(").replace(")", r"\)")):
    project_frames(walk, [constraint], _new(20, 42))


@pytest.mark.parametrize("field, value", [("slack", -1), ("slack", 6), ("slack", "a"), ("strength", 0), ("strength", 2),
                                          ("strength", None), ("slack", float("nan")), ("slack", [1])])
def test_slack_and_strength_are_checked_and_kept_in_files(field, value):
  row = {"type": "effector", "joint": "head", "times": [1], "positions": [[0, 1, 0]]}
  kept = row | {"slack": 0.1, "strength": 0.5}
  assert to_json(from_json({"version": 1, "constraints": [kept]}))["constraints"][0] == kept
  assert "slack" not in to_json(from_json({"version": 1, "constraints": [row]}))["constraints"][0]
  with pytest.raises(InputError, match=field):
    from_json({"version": 1, "constraints": [row | {field: value}]})
