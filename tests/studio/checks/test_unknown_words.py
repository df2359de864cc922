"""Which words of a sentence are worth a warning: those that a person would call unknown, and no others."""
import types

import pytest

from motion_jax_studio.checks.prompt_notes import notes_on, with_suggestion
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


@pytest.mark.parametrize("sentence", [
    "eine Person geht im Kreis", "une personne marche en avant", "una persona camina a la izquierda", "人が歩く",
    "человек идёт вперёд", "osoba idzie do przodu", "jemand springt", "asdf qwer"])
def test_a_sentence_in_another_language_has_one_note_that_says_so(model, sentence):
  note, = notes_on(types.SimpleNamespace(model=model), [sentence])
  assert note == f"{sentence!r}: this model reads English only; try 'a person walks forward'"


@pytest.mark.parametrize("sentence", [
    "backflip", "a boxer punches hard", "the man juggles flaming torches nonchalantly", "person vaults parkour", "",
    "a flibbertigibbet somersaults over caltrops", "walks 人"])
def test_unknown_english_words_are_no_other_language(model, sentence):
  assert model.captions.is_english(sentence)
