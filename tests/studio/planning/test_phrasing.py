"""Prompts in the words of kinematic captions: a direction for a walk, a hand for a punch."""
from ml_collections import ConfigDict

from motion_studio.language import parse
from motion_studio.planning.phrasing import (
  going_forward,
  in_words_of_captions,
  wants_words_of_captions,
  with_one_hand,
)


def test_a_walk_of_no_direction_leads_forward():
  for said, meant in (("a person walks", "a person walks forward"), ("an old man jogs", "an old man jogs forward"),
                      ("Someone is running.", "Someone is running forward"), ("walk", "walk forward"),
                      ("they walk!", "they walk forward")):
    assert going_forward(said) == meant and going_forward(meant) == meant
  for said in ("a person walks backward", "a man makes a u-turn while walking", "the man starts a run", "a dog barks",
               "", "someone stands still, then walks", "a person walks in a circle", "a person turns and walks"):
    assert going_forward(said) == said


def test_a_punch_of_no_hand_is_of_the_left():
  for said, subject in (("a man punches", "a man"), ("Someone punches forward.", "Someone"),
                        ("she strikes with the fist", "she"), ("the old person punches the air", "the old person"),
                        ("a boxer punches straight ahead", "a boxer")):
    meant = f"{subject} punches with the left hand"
    assert with_one_hand(said) == meant and with_one_hand(meant) == meant
  for said in ("a man punches with the right hand", "a man punches with both hands", "someone punches the bag",
               "he is punching", "a man strikes a pose", "a man boxes", "someone strikes with the foot", "",
               "a man kicks and punches"):
    assert with_one_hand(said) == said


def test_plans_get_the_words_of_captions():
  for prompt, prompts in (
      ("a person walks", ["a person walks forward"]),
      ("a person walks, then waves", ["a person walks forward", "a person waves"]),
      ("a man throws a punch", ["a man punches with the left hand"]),
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
