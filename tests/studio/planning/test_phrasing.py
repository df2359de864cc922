"""Prompts in the words of kinematic captions: a direction for a walk, a hand for a punch."""
from ml_collections import ConfigDict

from motion_jax_studio.language import parse
from motion_jax_studio.planning.phrasing import (
  going_forward,
  in_words_of_captions,
  wants_words_of_captions,
  with_one_hand,
)
from tests.studio.sentences import table


def test_a_walk_of_no_direction_leads_forward_and_a_punch_of_no_hand_is_of_the_left():
  change = lambda text: with_one_hand(going_forward(text))
  changed = {text: meant or text for text, meant in table("phrasing")}
  assert {text: change(text) for text in changed} == changed
  assert all(change(meant) == meant for meant in changed.values()) and change("") == ""


def test_plans_get_the_words_of_captions():
  for prompt, prompts in (
      ("a person walks", ["a person walks forward"]),
      ("a person walks, then waves", ["a person walks forward", "a person waves"]),
      ("a man kicks, then punches forward.", ["a man kicks", "a man punches with the left hand"])):
    plan = in_words_of_captions(parse(prompt))
    assert plan.prompts == prompts and not plan.is_plain and plan.requirements == parse(prompt).requirements
  for prompt in ("a man throws a right punch", "a man punches twice", "a person waves"):
    assert in_words_of_captions(parse(prompt)).segments == parse(prompt).segments


def test_which_models_get_them():
  config = lambda stage, **data: ConfigDict(dict(stage=stage, data=data))
  assert wants_words_of_captions(config("cdamd.generator", kinematic_captions=True))
  assert not wants_words_of_captions(config("cdamd.generator"))
  assert not wants_words_of_captions(config("cmdm.denoiser", kinematic_captions=True))
