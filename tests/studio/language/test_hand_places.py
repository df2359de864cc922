"""Words say where hands are, and other words about hands do not."""
from motion_jax_studio.language import parse
from motion_jax_studio.language.hand_places import places_of, without_hands
from tests.studio.sentences import table

LEFT, RIGHT, BOTH = ("left",), ("right",), ("left", "right")


def _places(text):
  """[[(place, sides)] of each segment] of a text; that of a plain one is read as its one action."""
  plan = parse(text, lambda text: False)
  segments = plan.segments
  if plan.is_plain:
    segments = (segments[0]._replace(action=plan.single),)
  return [[(place.place or place.gesture[0][0], place.sides) for place in own.values()] for own in places_of(segments)]


def test_places_are_read_from_words_that_say_one():
  """A gesture is a row of places, of which the first one counts here."""
  said = lambda text: ", ".join(f"{place} {'both' if len(sides) > 1 else sides[0]}" for place, sides in sum(
      _places(text), []))
  assert {text: said(text) for text, _ in table("hands")} == dict(table("hands"))


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


def test_the_rest_of_a_text_is_what_the_network_has_to_know():
  for text, rest in (
      ("a person walks with the arms out", "a person walks"), ("a person waves", "a person waves"),
      ("a man walks with his hands on his hips while nodding", "a man walks while nodding"),
      ("a person walks with a stick", "a person walks with a stick")):
    assert without_hands(text).strip() == rest
