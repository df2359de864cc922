"""A prompt is judged as a phrase, not word by word; what a model cannot do is said, with what it does instead."""
import json
from types import SimpleNamespace

import pytest

from motion_jax import runs
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.captions import TrainingCaptions
from motion_jax.motion.representations import get_layout
from motion_jax.text.captions import SUBJECTS
from motion_jax.text.encoder import load_text_encoder
from motion_studio import Pipeline
from motion_studio.language.repertoire import Repertoire, phrase_of


class Model(TextToMotionModel):
  """The captions of a shipped model, without its network."""
  abilities = ("sample_segments",)
  stats = SimpleNamespace(layout=get_layout("full"))

  def __init__(self, name):
    run = runs.load_run(name)
    with open(run.folder / "captions.json", encoding="utf-8") as file:
      rows = json.load(file)
    self.folder, self.config, self.encoder = run.folder, run.config, load_text_encoder(run.text)
    self.captions = TrainingCaptions(*zip(*rows), self.encoder, subjects=SUBJECTS)


@pytest.fixture(scope="module")
def pipeline():
  return Pipeline(Model("cdamd-small"))


@pytest.fixture(scope="module")
def repertoire(pipeline):
  return pipeline.planner.repertoire


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
    ("a person turns around slowly", True, False), ("a person walks like a zombie", True, True),
    # Every word of these stands in some caption.
    ("a person stretches", False, False), ("a person stretches the arms", False, False),
    ("a person sneaks forward", False, False), ("a person limps", False, False),
    ("a person leans to the left", False, False), ("a person opens a door", False, False),
    # One or two clips.
    ("a person jumps over an object", True, True), ("a person steps over something", True, True),
    ("a person raises the right hand to the face", True, True),
    ("a person does jumping jacks", True, True), ("a person climbs stairs", True, True),
    ("a person walks down the stairs", True, True),
    # A posture of limbs that is in no caption of the action.
    ("a person stands still with their arms stretched out", True, True),
    ("a person walks in a circle with one hand in front of them", True, True),
    ("a person jumps to the left", True, True), ("a person kicks low", True, True),
    ("a person raises the left knee", False, False), ("a person hops on the left leg", True, False),
    ("a person walks forward with relaxed arms", True, True), ("a person jumps with both feet", True, False)])
def test_phrases_are_known_by_meaning_and_verb(repertoire, prompt, known, few):
  found = repertoire.judge(prompt)
  assert found.known == known and (few or not known or not found.few) and (found.few or not few)
  assert found.nearest[0][0] >= found.nearest[1][0]


def test_what_few_clips_show_is_hardly_known_among_many(repertoire):
  assert repertoire.is_rare("a person walks like a zombie") and not repertoire.is_rare("a person walks")
  assert not repertoire.is_rare("a person juggles")  # a word of no caption has a note of its own
  few = Repertoire(["a person walks.", "a person waves."], None)  # no vectors are needed
  assert not few.is_rare("a person waves")  # a small set of clips has one of each


def test_suggestions_are_near_and_of_different_verbs(repertoire):
  found = repertoire.suggestions("a person stretches the arms")
  assert len(found) == 3 and all(phrase in repertoire.phrases for phrase in found)
  assert any("arm" in phrase for phrase in found) and len({phrase.split()[0] for phrase in found}) == 3


def test_what_is_not_known_is_said_once_with_what_is_made_and_three_that_can_be(pipeline):
  note, = pipeline.notes(["a person sneaks forward, then sits down"])
  assert note.startswith("cdamd-small has not learned 'a person sneaks forward'; what it knows nearest is 'walks")
  assert note.count("'") == 2 + 2 + 6 and "it can do, for example, '" in note
  assert "learned little like 'a person climbs stairs'" in pipeline.notes(["a person climbs stairs"])[0]
  assert pipeline.notes(["a person walks forward, then waves the right hand and sits down"]) == []
  word, = pipeline.notes(["a person does a backflip"])
  assert "does not know 'backflip'" in word and "it can do, for example" in word
  assert len(pipeline.notes([f"a person zz{letter}s" for letter in "abcdefgh"])) == 6


def test_of_a_denial_one_sentence_says_that_it_may_be_done(pipeline):
  note, = pipeline.notes(["a person does not walk"])
  assert note == "'a person does not walk' says 'not'; a model may do what follows nevertheless"
  assert not pipeline.notes(["a person does not move"])


@pytest.mark.parametrize("prompt, several", [
    ("two people shake hands", True), ("a man and a woman dance", True), ("people walk", True),
    ("a person hugs another person", True), ("they walk forward", False), ("a person waves both hands", False),
    ("a person takes two steps", False)])
def test_of_several_people_one_sentence_says_that_one_body_is_made(pipeline, prompt, several):
  found = [note for note in pipeline.notes([prompt]) if "only one body is made" in note]
  assert len(found) == several and all(prompt in note for note in found)


def test_an_empty_repertoire_judges_nothing():
  assert Repertoire([], None).judge("a person walks").nearest == [] == Repertoire([], None).suggestions("walks")


@pytest.mark.parametrize("sentence", ["a person claps", "a person puts the left hand on the hip and bows",
                                      "a person raises the hands to the face, then lowers them"])
def test_postures_need_no_note(pipeline, sentence):
  """Where they are made without the network; streams are not."""
  assert not pipeline.notes([sentence]) and pipeline.notes([sentence], postures=False)


def test_what_is_said_beside_a_posture_has_its_note(pipeline):
  note, = pipeline.notes(["a person juggles with the hands on the hips"])
  assert "juggles" in note
