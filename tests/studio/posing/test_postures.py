"""Postures come without the network: a body stands where it only leans or brings its hands to a place."""
from types import SimpleNamespace

import numpy as np
import pytest

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models.results import Motion, features_of
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.reaching import distance_to_place
from motion_jax.motion.representations import get_layout
from motion_jax.motion.retarget import retarget
from motion_jax_studio.language import Segment, parse
from motion_jax_studio.planning.standing import standing
from motion_jax_studio.posing.corrections import corrected
from motion_jax_studio.posing.postures import posed
from motion_jax_studio.steps import PlanPrompts
from tests.studio.posing.test_corrections import MODEL

_yes, _no = lambda prompt: True, lambda prompt: False
WALK = retarget(synthetic_joints("walk", 120, np.random.default_rng(1)))


def test_other_skeletons_keep_their_hands():
  kit = SimpleNamespace(stats=SimpleNamespace(layout=get_layout("full_kit")))
  motion = Motion(WALK.astype(np.float32), 20.0, (Caption("a person claps"),))
  assert posed(kit, motion, parse("a person claps")) is motion


def test_a_body_stands_where_the_model_does_not_know_the_words():
  plan = parse("a person walks, puts the left hand on the hip and bows", lambda text: False)
  assert standing(plan, _yes, _yes) is plan
  made = standing(plan, _no, _no)
  assert made.summary == "walks | stands still + puts the left hand on the hip | bows"
  assert made.requirements == plan.requirements
  plain = parse("a person holds the arms out to the sides")
  assert standing(plain, _no, _no).summary == "stands still + holds the arms out to the sides"
  for text in ("a person walks with the arms out", "a person raises the left hand", "he puts his hands on his knees",
               "he holds his hands up and sings"):
    plan = parse(text)
    assert standing(plan, _no, _no) is plan
  assert standing(parse("a person leans to the left"), _yes, _yes).summary == (
      "stands still + leans to the left")
  plan = parse("a person leans to the left while waving")
  assert standing(plan, _yes, _yes).summary == "stands still + leans to the left + waves"
  plan = parse("a person leans to the left while lifting the right foot")
  assert standing(plan, _yes, _yes) is plan


def test_words_without_a_verb_are_a_standing_posture():
  plan = parse("hands on hips")
  assert standing(plan, _no, _no).summary == "stands still + hands on hips"
  motion = Motion(WALK.astype(np.float32), 20.0, (Caption("", 0, 6),))
  assert distance_to_place(posed(MODEL, motion, standing(plan, _no, _no)).joints, "hips", "left").max() < 0.02


def test_a_gesture_that_the_model_can_make_is_sampled():
  throws, puts = parse("a person throws a ball"), parse("a person puts a hand on the hip")
  assert standing(throws, _no, _yes) is throws and standing(puts, _yes, _no) is puts
  assert standing(throws, _no, _no).summary == "stands still + throws a ball"
  assert standing(puts, _no, _yes).summary == "stands still + puts a hand on the hip"


def test_a_lean_is_read_from_the_words_that_say_one():
  for text, way, sways in (
      ("leans to the left", (1, 0), False), ("leans over to his right", (-1, 0), False),
      ("leans forward", (0, 1), False), ("tilts back slightly", (0, -1), False), ("slouches", (0, 1), False),
      ("sways", (1, 0), True), ("sways slightly to his left", (1, 0), False), ("rocks back and forth", (0, 1), True),
      ("sways from side to side", (1, 0), True)):
    assert parse(f"a person {text}").single.slots.lean == (way, sways), text
  for text in ("leans on a table", "tilts the head to the left", "walks to the left", "bows", "leans back in a chair",
               "rocks a baby", "tilts a glass to drink", "slumps to the ground", "sways the hips",
               "hunches over creeping"):
    assert parse(f"a person {text}").single.slots.lean is None, text


def test_a_plan_leans_in_its_time():
  motion = Motion(WALK.astype(np.float32), 20.0, (Caption("", 0, 3), Caption("", 3, 6)))
  made = posed(MODEL, motion, parse("a person leans to the left, then walks"))
  np.testing.assert_allclose(made.features, features_of(MODEL, made.joints))
  own, before = leans(made.joints, 1, 0), leans(WALK, 1, 0)
  assert np.median(own[20:58]) > 11 and np.abs(own - before)[80:].max() < 1
  again = posed(MODEL, made, parse("a person leans to the left, then walks"))
  assert np.abs(leans(again.joints, 1, 0) - own).max() < 8  # it leans already
  sways = leans(posed(MODEL, motion, parse("a person sways from side to side, then walks")).joints, 1, 0)
  assert sways[:60].max() > 8 and sways[:60].min() < -8
  walks = parse("a person walks, then bows")
  assert posed(MODEL, motion, walks) is motion


def test_a_bent_body_sways_about_its_own_lean():
  bent = lean(WALK, 0, 1, np.full(120, 35.0))
  motion = Motion(bent, 20.0, (Caption("", 0, 6),))
  own = leans(posed(MODEL, motion, parse("a person rocks back and forth")).joints, 0, 1)
  assert np.median(own) == pytest.approx(np.median(leans(bent, 0, 1)), abs=6)


def test_a_lean_beside_an_action_of_the_legs_is_left_to_the_network():
  plan = parse("a person leans to the left")
  both = plan.with_segments((Segment(plan.single, (parse("a person lifts the right foot").single,)),))
  assert standing(both, _no, _no) is both


def test_plans_with_constraints_stay_as_they_are():
  job = SimpleNamespace(planner=SimpleNamespace(plan=parse, with_postures=lambda plan: standing(plan, _no, _no)),
                        prompts=["a person claps"] * 2, plans=[None] * 2, constraints=[[], [object()]])
  PlanPrompts()(job)
  assert [plan.is_plain for plan in job.plans] == [False, True]


def test_a_posture_is_not_taken_for_the_wrong_hand():
  prompt = "a person holds the left arm out to the side"
  stands = np.repeat(WALK[:1], 60, axis=0)
  stands[:, 21, 2] += 0.02 * np.sin(np.arange(60) / 3)  # the other hand moves a little
  plan = standing(parse(prompt), _no, _no)
  motion = posed(MODEL, Motion(stands.astype(np.float32), 20.0, (Caption(prompt),)), plan)
  assert distance_to_place(motion.joints, "side", "left").max() < 0.02
  assert corrected(MODEL, motion, plan.requirements) is motion


def test_a_segment_without_time_is_left_alone():
  motion = Motion(WALK.astype(np.float32), 20.0, (Caption("", 0, 0), Caption("", 0, 6)))
  assert posed(MODEL, motion, parse("a person leans to the left, then walks")) is motion
  assert posed(MODEL, motion, parse("a person folds the arms, then walks", lambda text: False)) is motion
