"""Another attempt says an action that can be measured in the words of captions."""
from motion_jax_studio.language import parse
from motion_jax_studio.language.plain_words import in_plain_words
from tests.studio.sentences import table


def test_actions_with_one_requirement_get_the_words_of_captions_and_other_sentences_stay():
  for text, words in table("plain_words"):
    plan = parse(text)
    assert in_plain_words(plan).summary == words if words else in_plain_words(plan) is plan, text
