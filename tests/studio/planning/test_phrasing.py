"""Prompts in the words of kinematic captions: a direction for a walk, a hand for a punch."""
import pytest
from ml_collections import ConfigDict

from motion_studio.language import parse
from motion_studio.planning.phrasing import (
  going_forward,
  in_words_of_captions,
  wants_words_of_captions,
  with_one_hand,
)


@pytest.mark.parametrize("said, meant", [
    ("a person walks", "a person walks forward"), ("Someone is running.", "Someone is running forward"),
    ("an old man jogs", "an old man jogs forward"), ("walk", "walk forward"), ("they walk!", "they walk forward")])
def test_whoever_walks_and_no_word_says_where_walks_forward(said, meant):
  assert going_forward(said) == meant and going_forward(meant) == meant


@pytest.mark.parametrize("said, meant", [
    ("a man punches", "a man"), ("Someone punches forward.", "Someone"), ("she strikes with the fist", "she"),
    ("the old person punches the air", "the old person"), ("a boxer punches straight ahead", "a boxer")])
def test_whoever_punches_and_no_word_says_with_which_hand_punches_with_the_left(said, meant):
  meant = f"{meant} punches with the left hand"
  assert with_one_hand(said) == meant and with_one_hand(meant) == meant


@pytest.mark.parametrize("said", [
    "a man punches with the right hand", "a man punches with both hands", "someone punches the bag", "he is punching",
    "a man strikes a pose", "a man boxes", "someone strikes with the foot", "", "a man kicks and punches"])
def test_other_blows_stay_as_they_are(said):
  assert with_one_hand(said) == said


@pytest.mark.parametrize("said", [
    "a person walks backward", "a man makes a u-turn while walking", "the man starts a run", "a dog barks", "",
    "someone stands still, then walks", "a person walks in a circle", "a person turns and walks"])
def test_other_sentences_stay_as_they_are(said):
  assert going_forward(said) == said


@pytest.mark.parametrize("prompt, prompts", [
    ("a person walks", ["a person walks forward"]),
    ("a person walks, then waves", ["a person walks forward", "a person waves"]),
    ("a man throws a punch", ["a man punches with the left hand"]),
    ("a man kicks, then punches forward.", ["a man kicks", "a man punches with the left hand"])])
def test_walks_go_forward_and_punches_have_a_hand(prompt, prompts):
  plan = in_words_of_captions(parse(prompt))
  assert plan.prompts == prompts and not plan.is_plain and plan.requirements == parse(prompt).requirements


@pytest.mark.parametrize("prompt", ["a man throws a right punch", "a man punches twice", "a person waves"])
def test_other_words_stay(prompt):
  assert in_words_of_captions(parse(prompt)).segments == parse(prompt).segments


def test_which_models_get_them():
  config = lambda stage, **data: ConfigDict(dict(stage=stage, data=data))
  assert wants_words_of_captions(config("cdamd.generator", kinematic_captions=True))
  assert not wants_words_of_captions(config("cdamd.generator"))
  assert not wants_words_of_captions(config("cmdm.denoiser", kinematic_captions=True))
