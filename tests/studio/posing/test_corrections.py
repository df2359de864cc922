"""A body that sits down last stays seated, steps in place and to a side are taken there, feet are on the floor at some
time, and stairs lead the way that is said."""
from types import SimpleNamespace

import numpy as np
import pytest

from motion_jax.analysis.signals import Body
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.metrics.physics import planted_speed
from motion_jax.models.results import Motion
from motion_jax.motion.representations import get_layout
from motion_jax.motion.retarget import mirror, retarget
from motion_jax.motion.root_paths import bent, course
from motion_jax.motion.step_records import change_between
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.language import parse
from motion_jax_studio.language.path_shapes import BENT
from motion_jax_studio.posing.corrections import corrected
from tests.studio.checks.test_violations import _joints, _seated

MODEL = SimpleNamespace(stats=SimpleNamespace(layout=get_layout("full")),
                        config=SimpleNamespace(data=SimpleNamespace(mode="benchmark")))


def _motion(joints, *captions):
  return Motion(joints.astype(np.float32), 20.0, captions or (Caption("a person sits down"),))


def _finished(motion, prompt):
  return corrected(MODEL, motion, parse(prompt).requirements)


def _sits_and_rises():
  """Down from frame 20 to 44 of 80, up again before and behind."""
  stands = np.repeat(_joints("walk")[:1], 80, axis=0)
  rows = np.clip(np.minimum((np.arange(80) - 12) / 8, (52 - np.arange(80)) / 8), 0, 1)
  low = _seated(stands.copy(), np.ones(80, bool))
  return stands + (low - stands) * rows[:, None, None]


def test_a_body_that_sits_down_last_and_gets_up_again_stays_seated():
  prompt, motion = "a person sits down", _motion(_sits_and_rises())
  required = parse(prompt).requirements
  assert violation_score(motion.joints, required) > 0
  made = _finished(motion, prompt)
  assert violation_score(made.joints, required) == 0 and made.num_frames == 80
  np.testing.assert_allclose(made.joints[:12], motion.joints[:12], atol=1e-6)
  assert np.abs(np.diff(made.joints[60:], axis=0)).max() < 1e-6 and made.features.shape == (80, 263)
  assert np.linalg.norm(np.diff(made.joints, axis=0), axis=-1).max() < 0.15  # it comes to rest, and does not jump
  assert made.meta["steps"] == [
      {"step": "correct", "did": "kept seated"} | change_between(motion.joints, made.joints) | {
          "score": [violation_score(motion.joints, required), 0.0]}]


def test_a_body_that_gets_up_and_sits_down_once_more_stays_in_its_first_seat():
  once = _sits_and_rises()
  made = _finished(_motion(np.concatenate([once, once[:30]])), "a person sits down")
  np.testing.assert_allclose(made.joints[:12], once[:12], atol=1e-5)
  assert np.ptp(made.joints[50:, 0, 1]) < 1e-6 < 0.1 < np.ptp(once[50:, 0, 1])
  seated = _motion(np.concatenate([once[30:], once[:30]]), Caption("a person stands up and sits down"))
  assert _finished(seated, "a person stands up and sits down") is seated  # it does not come to sit twice


def test_a_body_that_may_get_up_does():
  motion = _motion(_sits_and_rises())
  for prompt in ("a person sits down and gets up again", "a person walks", "a person stands up"):
    assert _finished(motion, prompt) is motion, prompt


def test_only_the_last_action_is_held():
  joints = np.concatenate([_joints("walk")[:40], _sits_and_rises()])
  made = _finished(_motion(joints, Caption("a person walks", 0, 2), Caption("a person sits down", 2, 6)),
                   "a person walks, then sits down")
  np.testing.assert_allclose(made.joints[:52], joints[:52], atol=1e-5)
  assert violation_score(made.joints, parse("a person sits down").requirements) == 0


def test_feet_that_are_never_on_the_floor_come_down_to_it():
  joints = _joints("walk")
  floats, hangs = (_motion(joints + [0, 0.3, 0], Caption(text)) for text in ("a person walks", "a person hangs"))
  made = _finished(floats, "a person walks")
  assert abs(made.joints[:, [7, 8, 10, 11], 1].min()) < 0.02 and made.captions == floats.captions
  assert _finished(hangs, "a person hangs") is hangs
  jumps = _motion(_joints("jump"), Caption("a person jumps"))
  assert _finished(jumps, "a person jumps") is jumps


@pytest.mark.parametrize("prompt, side", [
    ("a person jogs on the spot", 0), ("a person takes side steps to the left", 1),
    ("someone sidesteps to the right", -1)])
def test_steps_in_place_and_to_a_side_are_taken_there(prompt, side):
  joints = retarget(synthetic_joints("walk", 100, np.random.default_rng(1)))
  walk = _motion(joints, Caption(prompt))
  made = _finished(walk, prompt).joints
  along, away = made[-1, 0, 0] - made[0, 0, 0], np.abs(made[:, 0, 2] - made[0, 0, 2]).max()
  assert away < 0.2 and (side * along > 1.0 if side else abs(along) < 0.2)
  assert planted_speed(made) < 0.12  # standing feet stand
  for free in ("a person walks forward", "a person walks to the left", "a person is running to the left"):
    assert _finished(walk, free) is walk


@pytest.mark.parametrize("prompt, side", [("a person jumps to the left", 1), ("a man takes a jump to his right", -1)])
def test_jumps_to_a_side_go_there_in_the_air(prompt, side):
  jumps = _motion(_joints("jump"), Caption(prompt))
  made = _finished(jumps, prompt).joints
  body = Body(jumps.joints, 20.0)
  flights = body.spans(body.air > 0.05, least=0.1)
  moved = made[:, 0, 0] - jumps.joints[:, 0, 0]
  assert moved[-1] * side == pytest.approx(0.5 * len(flights), abs=0.05)
  feet = np.linalg.norm(np.diff(made[:, [10, 11]], axis=0)[..., [0, 2]], axis=-1)
  assert feet[:flights[0][0] - 2].max() < 0.01  # they stand until they leave the ground
  assert _finished(jumps, "a person jumps forward") is jumps


def test_a_way_back_that_misses_the_beginning_leads_there():
  prompt = "a person walks forward, turns around and walks back"
  walk = retarget(synthetic_joints("walk", 160, np.random.default_rng(1)))
  middle = 0.56 * course(walk)[1][-1]  # it does not go far enough, either
  away = lambda turn: bent(walk, lambda gone: turn * np.clip(gone - middle + 0.5, 0, 1))
  motion = _motion(away(2.3), Caption(prompt))
  required = [one for one in parse(prompt).requirements if one.kind == "return"]
  assert required and violation_score(motion.joints, required) > 0
  made = _finished(motion, prompt).joints
  ends = np.linalg.norm((made[-1, 0] - made[0, 0])[[0, 2]])
  assert ends < 0.3 and violation_score(made, required) == 0
  np.testing.assert_allclose(made[:60], motion.joints[:60], atol=0.02)
  assert planted_speed(made) < planted_speed(motion.joints) + 0.02  # standing feet stand
  for other in (away(0.8), away(3.1)):  # it never turned around, and it comes back as it is
    other = _motion(other, Caption(prompt))
    assert _finished(other, prompt) is other


@pytest.mark.parametrize("prompt", [
    "a person walks in a circle to the right", "a man walks in a half circle", "a person walks in a zigzag",
    "a man walks in an arc", "a person jogs and turns to the right", "a person walks in a figure eight"])
def test_a_walk_is_bent_to_the_shape_that_is_said(prompt):
  frames = round(20 * max(parse(prompt).min_duration, 8.0))
  walk = _motion(retarget(synthetic_joints("walk", frames, np.random.default_rng(1))), Caption(prompt))
  required = [one for one in parse(prompt).requirements if one.kind in {*BENT, "turn"}]
  assert len(required) == 1 and violation_score(walk.joints, required) > 0
  made = _finished(walk, prompt).joints
  assert violation_score(made, required) == 0
  assert planted_speed(made) < planted_speed(walk.joints) + 0.05  # standing feet stand
  assert course(made)[1][-1] == pytest.approx(course(walk.joints)[1][-1], rel=0.2)  # as far as before
  again = _motion(made, Caption(prompt))
  assert _finished(again, prompt) is again
  short = _motion(walk.joints[:24], Caption(prompt))
  assert _finished(short, prompt) is short


def test_a_turn_on_the_spot_is_no_bend_of_a_path_and_a_body_that_stands_makes_no_side_steps():
  stands = _motion(np.repeat(_joints("walk")[:1], 60, axis=0), Caption("a person takes side steps to the left"))
  assert _finished(stands, "a person takes side steps to the left") is stands
  walk = _motion(retarget(synthetic_joints("walk", 160, np.random.default_rng(1))), Caption("a person turns left"))
  for prompt in ("a person turns left", "a person turns around while walking", "a person turns left, then right"):
    assert _finished(walk, prompt) is walk
  parts = walk.replace(captions=(Caption("a person turns left", 0, 4), Caption("a person walks", 4, 8)))
  assert _finished(parts, "a person turns left, then walks") is parts


@pytest.mark.parametrize("prompt", ["a person waves the right hand", "a person throws a ball with the right hand"])
def test_the_wrong_side_is_exchanged(prompt):
  required, motion = parse(prompt).requirements, _motion(_joints("wave_left"), Caption(prompt))
  assert violation_score(motion.joints, required) > 0
  made = _finished(motion, prompt)
  assert violation_score(made.joints, required) == 0
  np.testing.assert_allclose(made.joints, mirror(motion.joints), atol=1e-6)
  left = prompt.replace("right", "left")
  right = _motion(motion.joints, Caption(left))
  assert _finished(right, left) is right


def test_a_side_is_not_exchanged_where_something_else_is_of_one_side():
  motion = _motion(_joints("wave_left"), Caption("a person waves the right hand with the left foot ahead"))
  required = parse("a person waves the right hand").requirements
  assert violation_score(motion.joints, required) > 0
  assert corrected(MODEL, motion, required) is motion


@pytest.mark.parametrize("prompt, kind", [("he climbs a ladder", "ascend"), ("someone climbs down", "descend")])
def test_stairs_lead_up_or_down(prompt, kind):
  required = parse(prompt).requirements
  flat, rise = _joints("walk"), np.linspace(0, 0.9, 80)[:, None, None] * np.array([0, 1, 0])
  missing = [violation_score(flat + way, required) for way in (rise, 0 * rise, rise[::-1])]
  assert missing[0 if kind == "ascend" else 2] == 0 and 0.5 < missing[1] < 1
  assert missing[2 if kind == "ascend" else 0] >= missing[1]
  if kind == "ascend":  # who begins high up and comes down is the farther from it, the higher
    falls = np.clip(1.5 - 4 * np.linspace(0, 1, 80), 0, 1.5)[:, None, None] * np.array([0, 1, 0])
    assert violation_score(flat + falls, required) > violation_score(flat + rise[::-1], required) > 1
