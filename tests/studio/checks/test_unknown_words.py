"""Which words of a sentence are worth a warning: those that a person would call unknown, and no others."""
import pytest

from motion_studio.checks.prompt_notes import with_suggestion
from tests.studio.captioned import Captioned
from tests.studio.sentences import table


@pytest.fixture(scope="module")
def model():
  made = Captioned("cmdm-small")
  made.captions.unknown_words("a robot walks")  # reads all words
  return made


def test_words_that_a_person_would_call_unknown_have_a_warning_and_no_others(model):
  words = dict(table("unknown_words"))

  def said(sentence):
    for word in model.captions.unknown_words(sentence):
      shown = with_suggestion(model, word)
      assert shown.startswith(repr(word))
      yield word + shown.removeprefix(repr(word)).replace(" (did you mean '", "=").replace("'?)", "")

  assert {sentence: " ".join(said(sentence)) for sentence in words} == words
