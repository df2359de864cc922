"""A motion that misses what its prompt requires after all attempts says so: in a warning, in its meta, to the page."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax_studio.checks.reports import attempts_note, report, unmet_requirements
from motion_jax_studio.language import parse
from motion_jax_studio.server.requests import notes_of
from tests.analysis.test_describe import _jump, _kick, _walk, _wave
from tests.studio.test_resampling import JUMPS, Sampler


def test_what_is_missing_is_said_in_words():
  walk, kick = _walk(), _kick("left")
  for text, joints, missing in (
      ("a person kicks with the right leg", kick, ["no kick with the right leg seen"]),
      ("a person kicks with the left leg", kick, []),
      ("a person kicks three times", _kick("left", (1.0, 2.5)), ["2 kicks seen instead of 3"]),
      ("a person kicks three times with the left leg", kick, ["1 kick with the left leg seen instead of 3"]),
      ("a person jumps once, then bows", _jump(0.3), ["no bow seen"]),
      ("a person waves the right hand", _wave("left", 4), ["no waving with the right hand seen"]),
      ("a person punches", walk, ["no punch seen"]),
      ("a person walks in a circle to the left", walk, ["no full circle to the left seen"]),
      ("a person walks slowly", _walk(speed=1.6), ["the walk is not slow"]),
      ("a person sits down", walk, ["the body does not sit down"]),
      ("a person walks backward", walk, ["no walk backward seen"]), ("a person walks", walk, []),
      ("a person stands still", walk, ["the body does not stand still"]), ("a person eats", walk, [])):
    assert unmet_requirements(joints, parse(text).requirements) == missing, text


def test_a_turn_that_is_too_short_is_said_in_degrees():
  joints = synthetic_joints("turn_left", 80, np.random.default_rng(0))
  found, = unmet_requirements(joints, parse("a person turns all the way around to the left").requirements)
  assert found.startswith("a turn to the left by ") and found.endswith("degrees seen instead of 290 to 430")


def test_a_page_gets_the_same_sentence_once_for_each_take_that_missed():
  made = Sampler().best([JUMPS] * 2, 2)
  said = "2 attempts, no jump seen (prompt: 'a person jumps'); another seed may show it"
  assert notes_of(made[:1]) == [said] == [attempts_note(2, ["no jump seen"], JUMPS)]
  assert notes_of(made) == [f"take 1: {said}", f"take 2: {said}"]


def test_many_failures_are_few_lines():
  with pytest.warns(UserWarning) as said:
    report(["a person kicks"] * 9, [["no kick seen"]] * 8 + [[]], 4)
  assert len(said) == 6 and str(said[-1].message).startswith("3 more motions")
