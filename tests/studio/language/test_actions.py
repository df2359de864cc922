"""What verbs are about, and what is meant by those that say little."""
import pytest

from motion_jax.text.morphology import verb_of
from motion_studio.language import actions


def test_parts_of_the_body():
  part = lambda text: actions.part_of(verb_of(text.split()[0]), text.split()[1:])
  assert [part(text) for text in ("walks forward", "waves", "nods", "bows", "dances", "thinks", "bows down")] == [
      "legs", "arms", "head", "torso", "body", "", "torso"]
  assert [part(text) for text in ("raises the left knee", "shakes the head", "turns the head")] == [
      "legs", "head", "head"]
  assert part("waves to the man with long legs") == "arms" and part("kicks with the left foot") == "legs"
  assert actions.sides_of("waves the right hand".split()) == ("right",)
  assert actions.sides_of("turns left and waves".split()) == ()
  assert actions.sides_of("raises both hands".split()) == ("left", "right")
  assert actions.is_continuous("walk", []) and not actions.is_continuous("sit", ["down"])
  assert not actions.is_continuous("stand", ["up"])


@pytest.mark.parametrize("said, meant", [
    ("a person walks", "a person walks forward"), ("Someone is running.", "Someone is running forward"),
    ("an old man jogs", "an old man jogs forward"), ("walk", "walk forward"), ("they walk!", "they walk forward")])
def test_whoever_walks_and_no_word_says_where_walks_forward(said, meant):
  assert actions.going_forward(said) == meant and actions.going_forward(meant) == meant


@pytest.mark.parametrize("said, meant", [
    ("a man punches", "a man"), ("Someone punches forward.", "Someone"), ("she strikes with the fist", "she"),
    ("the old person punches the air", "the old person"), ("a boxer punches straight ahead", "a boxer")])
def test_whoever_punches_and_no_word_says_with_which_hand_punches_with_the_left(said, meant):
  meant = f"{meant} punches with the left hand"
  assert actions.with_one_hand(said) == meant and actions.with_one_hand(meant) == meant


@pytest.mark.parametrize("said", [
    "a man punches with the right hand", "a man punches with both hands", "someone punches the bag", "he is punching",
    "a man strikes a pose", "a man boxes", "someone strikes with the foot", "", "a man kicks and punches"])
def test_other_blows_stay_as_they_are(said):
  assert actions.with_one_hand(said) == said


@pytest.mark.parametrize("said", [
    "a person walks backward", "a man makes a u-turn while walking", "the man starts a run", "a dog barks", "",
    "someone stands still, then walks", "a person walks in a circle", "a person turns and walks"])
def test_other_sentences_stay_as_they_are(said):
  assert actions.going_forward(said) == said
