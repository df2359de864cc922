"""Notes on words that a model has not learned become warnings, also of a model without captions. What notes say:
tests/studio/language/test_repertoire.py."""
import shutil
import warnings

import pytest

from motion_jax.loading import load
from motion_jax_studio import Pipeline
from tests.studio.test_constraining import Refusing


def test_a_strange_word_is_named_once_before_anything_is_sampled(tiny_run):
  pipeline = Pipeline(Refusing(load(tiny_run)))
  for pipeline.warns, count in ((True, 1), (False, 0)):
    with warnings.catch_warnings(record=True) as caught, pytest.raises(pytest.fail.Exception):
      warnings.simplefilter("always")
      pipeline(["a flibbertigibbet walks"] * 2, 24, seed=0)
    notes = [str(warning.message) for warning in caught]
    assert len(notes) == count and all("'flibbertigibbet'" in note and "learned from is '" in note for note in notes)


def test_without_captions_the_text_encoder_decides(tiny_run, tmp_path):
  shutil.copytree(tiny_run, tmp_path / "run")
  (tmp_path / "run" / "captions.json").unlink()
  older = load(tmp_path / "run")
  older.encoder.out_of_vocabulary = lambda prompt: ["flibbertigibbet"]
  note, = Pipeline(older).notes(["a flibbertigibbet walks"])
  assert note.endswith("it may be ignored or misunderstood")
