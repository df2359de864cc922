"""A prompt is judged as a phrase, not word by word; what a model cannot do is said, with what it does instead."""
import re

import pytest

from motion_jax_studio import Pipeline
from motion_jax_studio.language.repertoire import Repertoire, phrase_of
from tests.studio.captioned import Captioned
from tests.studio.sentences import table


@pytest.fixture(scope="module")
def pipeline():
  made = Pipeline(Captioned("cdamd-small"))
  made.notes(["a person sneaks forward"])  # computes the vectors of all phrases
  made.notes(["a robot walks"], plan=False)  # and of all captions
  return made


@pytest.fixture(scope="module")
def repertoire(pipeline):
  return pipeline.planner.repertoire


def test_a_phrase_is_what_is_done_without_subject_pace_and_repetitions():
  for sentence, phrase in (
      ("Someone quickly walks forward.", "walks forward"), ("the figure walks at a slow pace", "walks"),
      ("a tired old man kicks twice with the left leg", "kicks with the left leg"),
      ("a person is waving.", "is waving"), ("he jumps up, three times in a row", "jumps up")):
    assert phrase_of(sentence) == phrase


def test_phrases_are_known_by_meaning_and_verb(repertoire):
  for phrase, known in table("repertoire"):
    judged = repertoire.judge(f"a person {phrase}")
    assert judged.known == bool(known) and (not known or judged.few == (known == "few")), phrase
    assert judged.nearest[0][0] >= judged.nearest[1][0]


def test_what_few_clips_show_is_hardly_known_among_many(repertoire):
  assert repertoire.rare_words("a person walks like a zombie") and not repertoire.rare_words("a person walks")
  assert not repertoire.rare_words("a person juggles")  # a word of no caption has a note of its own
  few = Repertoire(["a person walks.", "a person waves."], None)  # no vectors are needed
  assert not few.rare_words("a person waves")  # a small set of clips has one of each


def test_what_is_not_known_is_said_once_with_what_is_made(pipeline):
  note, = pipeline.notes(["a person sneaks forward, then sits down"])
  assert note.startswith("cdamd-small has not learned 'a person sneaks forward'; what it knows nearest is 'walks")
  assert note.count("'") == 2 + 2 and len(note) < 160  # no list of other things
  assert "learned little like 'a person climbs stairs'" in pipeline.notes(["a person climbs stairs"])[0]
  assert pipeline.notes(["a person walks forward, then waves the right hand and sits down"]) == []
  word, = pipeline.notes(["a person does a backflip"])
  assert "does not know 'backflip'" in word


@pytest.mark.parametrize("prompt, says", [
    ("a person does a jumping jack", "learned little like 'a person does a jumping jack' ('jack' in 4 of 1,1"),
    ("a person walks on tiptoes", "learned little like 'a person walks on tiptoes' ('tiptoes' in 1 of 1,1"),
    ("a person tiptoes across the room", "does not know 'room' in 'a person tiptoes across the room' ('tiptoes' in 1"),
    ("a boxer throws a left jab, then a right hook", "('boxer' in 3, 'jab' in 1"),
    ("a person does the moonwalk", "does not know 'moonwalk' in 'a person does the moonwalk'"),
    ("a person walks, then does the moonwalk", "does not know 'moonwalk' in"),
    ("a boxer puts the hands on the hips", ""), ("a boxer throws a ball", ""), ("a person claps, then bows", "")])
def test_what_few_captions_say_is_noted_and_nothing_that_was_not_said(pipeline, prompt, says):
  """Also where the verb became another one; standing still, below hands that are placed, is no word of the prompt."""
  notes = pipeline.notes([prompt])
  assert len(notes) == bool(says) and all(says in note for note in notes), notes


def test_words_of_no_caption_have_a_note_with_what_is_made_instead(pipeline):
  """Although the text encoder knows them well."""
  for prompt, word in (("a robot walks", "robot"), ("a person climbs a table", "table")):
    assert pipeline.model.encoder.out_of_vocabulary(prompt) == []
    note, = pipeline.notes([prompt], plan=False)
    instead = re.search("nearest caption that cdamd-small learned from is '(.*)'$", note)
    assert f"know {word!r} in" in note and instead[1] in pipeline.model.captions.texts
  assert not pipeline.notes([
      "a person walks", "someone is walking", "a WOMAN walked, then ran 3 times and sat down quickly!"], plan=False)


def test_of_many_prompts_few_have_a_note(pipeline):
  numbers = ("two", "three", "four", "five", "six", "ten", "several")
  *_, last = notes = pipeline.notes([f"{number} people walk" for number in numbers], plan=False)
  assert len(notes) == 6 and last == "the model does not know some words or actions of 2 more prompts"


def test_a_verb_that_is_made_as_a_wider_one_has_a_note(pipeline):
  note, = pipeline.notes(["a person curtsies"])
  assert note == "'curtsies' is made as 'bows', the nearest that cdamd-small has learned"
  # A walk is bent to a figure of eight, whatever the captions say.
  assert not pipeline.notes(["a man walks in a figure of 8", "a person jogs in a figure-eight pattern, then bows"])
  # A manner keeps what sets a verb apart, and what stays as it is written is known.
  assert not pipeline.notes(["someone sidesteps to the right", "a person strolls", "a person bows"])


def test_of_a_denial_one_sentence_says_that_it_may_be_done(pipeline):
  note, = pipeline.notes(["a person does not walk"])
  assert note == "'a person does not walk' says 'not'; a model may do what follows nevertheless"
  assert not pipeline.notes(["a person does not move"])


def test_of_several_people_one_sentence_says_that_one_body_is_made(pipeline):
  several = ["two people shake hands", "a man and a woman dance", "people walk", "a person hugs another person"]
  for prompt in (*several, "they walk forward", "a person waves both hands", "a person takes two steps"):
    notes = [note for note in pipeline.notes([prompt]) if "only one body is made" in note]
    assert len(notes) == (prompt in several) and all(prompt in note for note in notes), prompt


def test_an_empty_repertoire_judges_nothing():
  assert Repertoire([], None).judge("a person walks").nearest == []


def test_postures_need_no_note_but_what_is_said_beside_them(pipeline):
  """Where they are made without the network; streams are not."""
  for sentence in ("a person claps", "a person puts the left hand on the hip and bows",
                   "a person raises the hands to the face, then lowers them"):
    assert not pipeline.notes([sentence]) and pipeline.notes([sentence], postures=False), sentence
  note, = pipeline.notes(["a person juggles with the hands on the hips"])
  assert "juggles" in note
