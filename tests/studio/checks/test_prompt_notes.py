"""Notes on words and actions that a model has not learned: which they are, what is made instead, what it can do."""
import re
import shutil
import warnings

import pytest

from motion_jax.loading import load
from motion_studio import Pipeline
from tests.studio.captioned import Captioned


def warned(act, *args, **options):
  with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    act(*args, **options)
  return [str(warning.message) for warning in caught]


def test_a_strange_word_is_named_once(tiny_run):
  pipeline = Pipeline(tiny_run)
  made = lambda: pipeline("a flibbertigibbet walks", 24, seed=0, max_attempts=1, num_steps=3, lag=2)
  note, = warned(made)
  assert "'flibbertigibbet'" in note and "the nearest of them is '" in note
  pipeline.warns = False
  assert warned(made) == []


@pytest.fixture(scope="module")
def shipped():
  made = Pipeline(Captioned("cmdm-small"))
  made.notes(["a person curtsies"])
  return made


def test_the_shipped_model_says_what_it_never_learned(shipped):
  """Words that its text encoder knows well, but that stand in no training caption; and what it makes instead."""
  for prompt, word in (("a robot walks", "robot"), ("a person does a headspin", "headspin"),
                       ("a person climbs a table", "table")):
    assert shipped.model.encoder.out_of_vocabulary(prompt) == []
    note, = shipped.notes([prompt], plan=False)
    instead = re.search("nearest of them is '(.*)'; it can do, for example, '", note)
    assert f"know {word!r} in" in note and instead[1] in shipped.model.captions.texts
  note, = shipped.notes(["a person does a backflip"])  # two captions of one clip say so
  assert "has learned little like 'a person does a backflip'" in note
  assert not shipped.notes([
      "a person walks", "someone is walking", "a WOMAN walked, then ran 3 times and sat down quickly!"], plan=False)
  assert len(shipped.notes([f"zz{letter} walks" for letter in "abcdefgh"], plan=False)) == 6


def test_a_verb_that_is_made_as_a_wider_one_is_said(shipped):
  note, = shipped.notes(["a person curtsies"])
  assert note == "'curtsies' is made as 'bows', the nearest that cmdm-small has learned"
  # A walk is bent to a figure of eight, whatever the captions say.
  assert not shipped.notes(["a man walks in a figure of 8", "a person jogs in a figure-eight pattern, then bows"])
  # A manner keeps what sets a verb apart, and what stays as it is written is known.
  assert not shipped.notes(["someone sidesteps to the right", "a person strolls", "a person bows"])


def test_without_captions_the_text_encoder_decides(tiny_run, tmp_path):
  shutil.copytree(tiny_run, tmp_path / "run")
  (tmp_path / "run" / "captions.json").unlink()
  older = load(tmp_path / "run")
  older.encoder.out_of_vocabulary = lambda prompt: ["flibbertigibbet"]
  note, = Pipeline(older).notes(["a flibbertigibbet walks"])
  assert note.endswith("it may be ignored or misunderstood")
