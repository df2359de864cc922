"""Sentences become the references' word vectors; no file can make us run code."""
import pickle

import numpy as np
import pytest

from motion_jax.evaluators import words
from tests import fixtures
from tests.golden import check, golden


# How a motion is cut is not recomputed here: tests/evaluation/test_test_set.py has the rule.
@golden("word_vectors", leave_out=("item/", "m_length/"), bounds={"": (0, 0)})
def run_word_vectors(fixture, dtype):
  vectors = words.WordVectors(fixture.config["vocabulary"], fixture["in/vectors"])
  return {f"{name}/{i}": array for i, arrays in enumerate(zip(*vectors(fixture.config["sentences"])))
          for name, array in zip(("words", "pos", "length"), arrays)}


@golden("text_assembly", leave_out=("motion", "frames"), bounds={"": (0, 0)})
def run_text_assembly(fixture, dtype):
  vectors = words.WordVectors(fixture["in/vocabulary"].tolist(), fixture["in/vectors"])
  sentences = fixture["in/tokens"].tolist()
  joined = ["_".join(f"{word}/{pos}" for word, pos in words.assemble(sentence)) for sentence in sentences]
  return dict(zip(("words", "tags", "sentence"), vectors(sentences))) | {"joined": np.array(joined)}


@pytest.mark.parametrize("name", ["cmdm/word_vectors", "cdamd/text_assembly"])
def test_golden(name):
  assert not check(fixtures.path(f"{name}.npz")).failures


VOCABULARY = ["unk", "walk", "sos", "eos", "person"]


def glove(folder):
  """A folder as the benchmarks ship it: rows of the vectors are not in the order of the words."""
  rows = {word: len(VOCABULARY) - 1 - i for i, word in enumerate(VOCABULARY)}
  np.save(folder / "our_vab_data.npy", np.arange(20.0).reshape(5, 4))
  (folder / "our_vab_words.pkl").write_bytes(pickle.dumps(VOCABULARY))
  (folder / "our_vab_idx.pkl").write_bytes(pickle.dumps(rows))
  return folder


def test_a_glove_folder_is_converted_once(tmp_path):
  read = words.load_words(glove(tmp_path))
  np.testing.assert_array_equal(read(["walk/VERB"])[0][0, 1], [12, 13, 14, 15])
  path = words.convert_glove(tmp_path)
  for name in words.GLOVE_FILES:
    (tmp_path / name).unlink()
  for again in (words.load_words(path), words.load_words(tmp_path)):
    np.testing.assert_array_equal(again.vectors, read.vectors)
    assert again.rows == read.rows


class Harm:
  def __reduce__(self):
    return print, ("this must never be run",)


def test_harmful_and_broken_files_are_refused(tmp_path, capsys):
  with pytest.raises(FileNotFoundError, match="our_vab_data.npy"):
    words.load_words(tmp_path)
  with pytest.raises(FileNotFoundError, match="no vocabulary"):
    words.load_words(tmp_path / "none.npz")
  glove(tmp_path)
  for bad in (Harm(), {"a": Harm()}, np.ones(3)):
    (tmp_path / "our_vab_idx.pkl").write_bytes(pickle.dumps(bad))
    with pytest.raises(ValueError, match="our_vab_idx.pkl is no plain list or table"):
      words.load_words(tmp_path)
  assert not capsys.readouterr().out
  (tmp_path / "our_vab_idx.pkl").write_bytes(pickle.dumps(VOCABULARY)[:9])
  with pytest.raises(ValueError, match="fetch it again"):
    words.load_words(tmp_path)
  (tmp_path / "our_vab_idx.pkl").write_bytes(pickle.dumps({"walk": 99}))
  with pytest.raises(ValueError, match="do not belong together"):
    words.load_words(tmp_path)
  (tmp_path / "our_vab.npz").write_bytes(b"no zip")
  with pytest.raises(ValueError, match="is no vocabulary"):
    words.load_words(tmp_path)


def test_sentences():
  vectors = words.WordVectors(VOCABULARY, np.eye(5))
  line, tokens = "a/DET person/NOUN walk/VERB", ["a/DET", "person/NOUN", "walk/VERB"]
  for one, other in zip(vectors([line]), vectors([tokens])):
    np.testing.assert_array_equal(one, other)
  rows, classes, lengths = vectors([line, "", " ".join(["walk/VERB"] * 30)], max_words=4)
  assert lengths.tolist() == [5, 2, 6] and rows.shape == (3, 6, 5) and classes.shape == (3, 6, 15)
  assert rows[0].argmax(-1).tolist() == [2, 0, 4, 1, 3, 0]
  assert classes[0].argmax(-1).tolist() == [14, 14, 1, 12, 14, 14]
  with pytest.raises(ValueError, match="'walks', expected lemma/POS"):
    vectors(["walks"])
