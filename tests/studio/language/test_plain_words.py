"""Another attempt says an action that can be measured in the words of captions."""
from motion_studio.language import parse
from motion_studio.language.plain_words import in_plain_words


def test_actions_with_one_requirement_get_the_words_of_captions():
  plain = {
      "the person does a couple of small kicks with his left leg": "kicks with the left foot",
      "a man staggers to the left in a large sideways step": "takes steps to the left",
      "a person walks forward and gives a slight kick with the right foot": "walks forward | kicks with the right foot",
      "a person walks forward and raises their arms in victory": "walks forward + raises both hands",
      "a person jumps to his right": "jumps to the right",
      "a person bends over, then spins around": "bends forward in a bow | turns around",
      "someone turns around to her left": "turns around to the left",
      "a person walks in an s shape": "walks in a zigzag", "someone is standing still": "stands still"}
  assert {text: in_plain_words(parse(text)).summary for text in plain} == plain


def test_other_sentences_stay_as_they_are():
  for text in ("a person walks forward", "a person stands still", "a person kicks with the left foot",
               "a person turns left while walking", "somebody sings", "a person swims, then drinks"):
    plan = parse(text)
    assert in_plain_words(plan) is plan, text
