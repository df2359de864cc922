"""English inflection: base forms, the forms of a verb, and forms that must not be taken for verbs."""
import pytest

from motion_jax.text.lexicon import ACTIONS
from motion_jax.text.morphology import (
  BASE_OF,
  IRREGULAR,
  base_form,
  is_participle,
  is_past,
  possible_bases,
  present_participle,
  third_person,
  verb_of,
)


@pytest.mark.parametrize("verb, third, participle", [
    ("wave", "waves", "waving"), ("sit", "sits", "sitting"), ("lie", "lies", "lying"), ("carry", "carries", "carrying"),
    ("play", "plays", "playing"), ("box", "boxes", "boxing"), ("lean", "leans", "leaning"), ("have", "has", "having"),
    ("pivot", "pivots", "pivoting"), ("tiptoe", "tiptoes", "tiptoeing")])
def test_the_forms_of_a_verb(verb, third, participle):
  assert third_person(verb) == third and present_participle(verb) == participle


def test_the_forms_of_verbs_of_movement_are_read_as_those_verbs():
  for verb in ACTIONS:
    assert verb_of(third_person(verb)) == verb_of(present_participle(verb)) == verb_of(verb) == verb
    assert is_participle(present_participle(verb)) and not is_participle(verb)
    if len(verb) > 3:  # shorter stems are not tried: "sing" is no form of "s"
      assert verb in possible_bases(third_person(verb)) & possible_bases(present_participle(verb))
  for word in ("shot", "sang", "taken", "ring", "left", "", "person"):
    assert verb_of(word) == "" and not is_participle(word), word


def test_irregular_forms_have_one_base():
  forms = [form for written in IRREGULAR.values() for form in written.split()]
  assert len(forms) == len(set(forms)) == len(BASE_OF)
  assert verb_of("ran") == "run" and verb_of("lay") == verb_of("lying") == "lie" and "foot" in possible_bases("feet")
  assert possible_bases("lay") == {"lay"}  # a base form itself
  assert "happy" in possible_bases("happily") and "fast" in possible_bases("faster")


def test_which_words_are_past_tenses():
  assert all(map(is_past, "walked sat stood waved ran bent hopped".split()))
  assert not any(map(is_past, "walk walks walking put red bed lying hands".split()))


def test_a_base_form_is_one_of_the_known_words():
  assert base_form("hopped", {"hop"}) == "hop" and base_form("hopped", {"walk"}) == ""
  assert base_form("carries", {"carry"}) == "carry" and base_form("boxes", {"box"}, ("es",)) == "box"
