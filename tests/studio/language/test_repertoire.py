"""A prompt is judged as a phrase, not word by word; what a model cannot do is said, with what it does instead."""
import json

import pytest

from motion_jax import runs
from motion_jax.models.base import TextToMotionModel
from motion_jax.text.captions import SUBJECTS
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.vocabulary import Vocabulary
from motion_studio.language.repertoire import Repertoire, phrase_of


class Model(TextToMotionModel):
  """The words of a model that ships, without its network."""

  def __init__(self, name):
    run = runs.load_run(name)
    with open(run.folder / "captions.json", encoding="utf-8") as file:
      rows = json.load(file)
    self.folder, self.encoder = run.folder, load_text_encoder(run.text)
    self._learned = Vocabulary([text for text, _ in rows], SUBJECTS), [frames for _, frames in rows]


@pytest.fixture(scope="module")
def model():
  return Model("cdamd-small")


@pytest.mark.parametrize("sentence, phrase", [
    ("Someone quickly walks forward.", "walks forward"), ("a tired old man kicks twice with the left leg", "kicks with "
     "the left leg"), ("the figure walks at a slow pace", "walks"), ("a person is waving.", "is waving"),
    ("he jumps up, three times in a row", "jumps up")])
def test_a_phrase_is_what_is_done_without_who_how_fast_and_how_often(sentence, phrase):
  assert phrase_of(sentence) == phrase


@pytest.mark.parametrize("prompt, known, few", [
    ("a person walks forward", True, False), ("someone sits down", True, False), ("a man bows deeply", True, False),
    ("she waves her right hand", True, False), ("a person kicks with the left foot", True, False),
    ("a person drinks from a cup", True, False), ("a person throws three punches", True, False),
    ("a person turns around slowly", True, False), ("a person walks like a zombie", True, False),
    # Every word of these stands in some caption.
    ("a person stretches", False, False), ("a person stretches the arms", False, False),
    ("a person sneaks forward", False, False), ("a person limps", False, False),
    ("a person leans to the left", False, False), ("a person opens a door", False, False),
    # One or two clips.
    ("a person does jumping jacks", True, True), ("a person climbs stairs", True, True),
    ("a person walks down the stairs", True, True)])
def test_phrases_are_known_by_meaning_and_verb(model, prompt, known, few):
  found = model.repertoire.judge(prompt)
  assert found.known == known and (few or not known or not found.few) and (found.few or not few)
  assert found.nearest[0][0] >= found.nearest[1][0]


def test_suggestions_are_near_and_of_different_verbs(model):
  found = model.repertoire.suggestions("a person stretches the arms")
  assert len(found) == 3 and all(phrase in model.repertoire.phrases for phrase in found)
  assert any("arm" in phrase for phrase in found) and len({phrase.split()[0] for phrase in found}) == 3


def test_what_is_not_known_is_said_once_with_what_is_made_and_three_that_can_be(model):
  note, = model.notes_of(["a person sneaks forward, then sits down"])
  assert note.startswith("cdamd-small has not learned 'a person sneaks forward'; what it knows nearest is 'walks")
  assert note.count("'") == 2 + 2 + 6 and "it can do, for example, '" in note
  assert "learned little like 'a person climbs stairs'" in model.notes_of(["a person climbs stairs"])[0]
  assert model.notes_of(["a person walks forward, then waves the right hand and sits down"]) == []
  word, = model.notes_of(["a person does a backflip"])
  assert "does not know 'backflip'" in word and "it can do, for example" in word
  assert len(model.notes_of([f"a person zz{letter}s" for letter in "abcdefgh"])) == 6


@pytest.mark.parametrize("prompt, several", [
    ("two people shake hands", True), ("a man and a woman dance", True), ("people walk", True),
    ("a person hugs another person", True), ("they walk forward", False), ("a person waves both hands", False),
    ("a person takes two steps", False)])
def test_of_several_people_one_sentence_says_that_one_body_is_made(model, prompt, several):
  found = [note for note in model.notes_of([prompt]) if "only one body is made" in note]
  assert len(found) == several and all(prompt in note for note in found)


def test_an_empty_repertoire_judges_nothing():
  assert Repertoire([], None).judge("a person walks").nearest == [] == Repertoire([], None).suggestions("walks")
