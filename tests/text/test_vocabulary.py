"""Words that stand in no caption: found in every form, function words and numbers left alone; candidates by words."""
import pytest

from motion_jax.text.vocabulary import Vocabulary

CAPTIONS = ["a person walks forward.", "someone sits down and waves both hands.", "a man runs quickly to the left."]


@pytest.mark.parametrize("sentence, missing", [
    ("a person walked, is walking, walks and walk", []),
    ("someone ran, sat and waved one hand", []),           # irregular forms
    ("The MAN is RUNNING very quick with his 3 hands", []),  # capitals, endings, numbers, function words
    ("he will be there until then", []),
    ("a zombie walks like a robot, a zombie", ["zombie", "robot"]),
    ("a person leaves", ["leaves"]),                        # "left" is a direction, not what leaving was
    ("", []),
])
def test_what_no_caption_says(sentence, missing):
  assert Vocabulary(CAPTIONS).missing(sentence) == missing


def test_function_words_explain_nothing_and_other_words_for_who_moves_do():
  assert Vocabulary(["a person reaches for it with both hands."]).missing("a forest, a bother") == ["forest", "bother"]
  assert Vocabulary(CAPTIONS).missing("a woman walks") == ["woman"]
  assert Vocabulary(CAPTIONS, ("a woman", "somebody")).missing("a woman walks, women run") == []


def test_few_captions_are_all_candidates_and_of_many_those_that_share_words():
  assert Vocabulary(CAPTIONS).candidates("waves") == [0, 1, 2]
  many = Vocabulary([f"a person walks {i} times." for i in range(40)] + ["a person waves."])
  found = many.candidates("someone waved while walking", most=4)
  assert len(found) == 4 and 40 in found
  assert len(many.candidates("swims", most=4)) == 4  # no shared word: a sample of all
