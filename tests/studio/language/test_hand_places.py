"""Words say where hands are, and other words about hands do not."""
import pytest

from motion_studio.language import parse
from motion_studio.language.hand_places import hand_place_of, places_of, without_hands

LEFT, RIGHT, BOTH = ("left",), ("right",), ("left", "right")


def _places(text):
  """[[(place, sides)] of each segment] of a text; that of a plain one is read as its one action."""
  plan = parse(text, lambda text: False)
  segments = plan.segments
  if plan.is_plain:
    segments = (segments[0]._replace(action=plan.single),)
  return [[(one.place, one.sides) for _, one in own] for own in places_of(segments)]


@pytest.mark.parametrize("text, place, sides", [
    ("a person holds the arms out to the sides", "side", BOTH),
    ("a man walks with his arms outstretched", "side", BOTH),
    ("someone stretches her left arm out to the side", "side", LEFT),
    ("a person reaches the right hand straight out to the right", "side", RIGHT),
    ("a person walks stiffly with both arms out in front of them", "front", BOTH),
    ("a person reaches his right arm straight forward", "front", RIGHT),
    ("a person reaches up with the left hand", "up", LEFT),
    ("a person puts both arms up over the head", "up", BOTH),
    ("the person lifts his left hand to his face", "face", LEFT),
    ("a person holds both hands up in front of his face", "face", BOTH),
    ("a man covers his eyes with both hands", "face", BOTH),
    ("a person drinks with the left hand", "face", LEFT),
    ("a person puts a hand to the ear", "ear", RIGHT), ("a person is holding a cell phone to ear", "ear", RIGHT),
    ("she brings a cup to her mouth with the left hand", "face", LEFT),
    ("she touches her head with the left hand", "head", LEFT),
    ("a person touches head with left hand", "head", LEFT),
    ("a person stands in a t pose", "side", BOTH),
    ("a man touches his head or face with the right hand", "head", RIGHT),
    ("she touches the left side of her face with the left hand", "face", LEFT), ("a soldier salutes", "head", RIGHT),
    ("a person puts the right hand on the left shoulder", "shoulder", RIGHT),
    ("a person walks with the hands on the hips", "hips", BOTH),
    ("he puts his hand on his stomach", "stomach", RIGHT),
    ("a person raises both hands to their chest", "chest", BOTH),
    ("a person raises both arms to chest height", "front", BOTH),
    ("a person folds the arms", "crossed", BOTH),
    ("a person stands with arms crossed", "crossed", BOTH),
    ("a person puts his hands together", "together", BOTH),
    ("a man walks with his hands behind his back", "back", BOTH),
    ("a person places both hands on the knees", "knees", BOTH),
    ("a person lowers the left arm", "down", LEFT),
    ("a person drops both arms to the sides", "down", BOTH),
    ("a person scratches his head with the left hand", "head", LEFT),
    ("a person rubs his hands together", "together", BOTH), ("a person folds the arms above the head", "up", BOTH),
    ("he holds both hands out in front of him at shoulder height", "front", BOTH),
    ("a person reaches out with both arms", "front", BOTH)])
def test_a_place_is_read_from_the_words(text, place, sides):
  assert _places(text) == [[(place, sides)]]


@pytest.mark.parametrize("text", [
    "a person waves the right hand", "a person raises the left hand", "a person walks with the arms at the sides",
    "a person walks, swinging the arms forward", "a person swings the arms back and forth",
    "a person runs with the arms pumping up and down", "a person picks up a box with both hands",
    "a person circles the wrists", "a person walks in a circle around his hands", "a person circles the head",
    "a person walks forward", "a person raises the left hand up and down", "a man jogs with his arms bent in front",
    "a person punches with the left hand", "a person lifts the left knee", "a person extends the arms backward",
    "a person does push ups with the hands wide", "a person kneels with the hands on the ground in front of him",
    "a person pushes himself up from the ground", "he throws himself on the floor", "a person reaches the stairs",
    "someone grabs his left foot with the right hand", "a person points up", "she strikes a pose",
    "a person turns the head to the left"])
def test_other_words_say_no_place(text):
  assert not any(_places(text))


@pytest.mark.parametrize("text, first, sides", [
    ("a person claps", "together", BOTH), ("a bird flaps both arms", "side", BOTH),
    ("a person throws a ball", "ear", RIGHT), ("he tosses it with the left hand", "ear", LEFT),
    ("a person pushes a box", "chest", BOTH),
    ("a person pulls with the left hand", "front", LEFT), ("someone points ahead", "front", RIGHT)])
def test_a_gesture_is_a_row_of_places(text, first, sides):
  place = hand_place_of(parse(text).single)
  assert place.gesture[0][0] == first and place.sides == sides


def test_a_gesture_that_is_counted_ends():
  once, thrice = (hand_place_of(parse(f"a person claps{times}").actions[0]) for times in ("", " three times"))
  assert once.rhythm and len(once.gesture) == 2 and not thrice.rhythm and len(thrice.gesture) == 7


def test_hands_are_those_of_the_action_before():
  assert _places("a person raises the left hand to the face, then lowers it") == [[("face", LEFT)], [("down", LEFT)]]
  assert _places("a person holds the arms out to the sides, bows and drops them") == [
      [("side", BOTH)], [], [("down", BOTH)]]
  assert _places("a person lowers it") == [[]]
  assert _places("a person raises both hands, then puts them on the hips") == [[], [("hips", BOTH)]]
  assert _places("a person puts the hands on the hips, then drops to the floor") == [[("hips", BOTH)], []]


def test_hands_that_another_action_moves_at_the_same_time_are_in_no_place():
  assert _places("a person waves the right hand while putting the left hand on the hip") == [[("hips", LEFT)]]
  assert _places("a person with the hands on the hips waves") == [[]]
  assert _places("a person walks and waves with the hands on the hips") == [[]]


@pytest.mark.parametrize("text, rest", [
    ("a person walks with the arms out", "a person walks"), ("a person waves", "a person waves"),
    ("a man walks with his hands on his hips while nodding", "a man walks while nodding"),
    ("a person walks with a stick", "a person walks with a stick")])
def test_the_rest_of_a_text_is_what_the_network_has_to_know(text, rest):
  assert without_hands(text).strip() == rest
