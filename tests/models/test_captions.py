"""Statistics of training captions: the nearest ones, the lengths of their clips, words that they lack."""
import shutil

import numpy as np
import pytest

from motion_jax.loading import load
from motion_jax.models.shared.captions import TrainingCaptions
from motion_jax.text.captions import of_a_person


class Encoder:
  """Sentence vectors of words in a row: the more words two sentences share, the nearer they are."""
  fingerprint = "test"
  words = ("walks", "waves", "runs", "person")

  def many_sentences(self, sentences):
    vectors = np.array([[float(word in sentence) for word in self.words] for sentence in sentences])
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)

  sentence = many_sentences

  def synonym(self, word, others):
    return "runs" if word == "jogs" else ""

  def unreadable(self, prompt):
    return []

  def out_of_vocabulary(self, prompt):
    return ["walks"]


def captions(frames=(40, 100, 150), fps=20.0):
  texts = ["a person walks", "a person waves", "a person runs", *["the cat sits"] * 3][:len(frames)]
  return TrainingCaptions(texts, frames, Encoder(), fps, ("someone",))


@pytest.mark.parametrize("fps", (12.5, 20.0, 30.0))
def test_natural_lengths_are_3_to_10_seconds_at_any_rate(fps):
  for frames, expected in (([1], 3 * fps), ([10**4], 9.8 * fps), ([40, 100, 150], 100),
                           ([100, 101, 102, 113, 114, 1000], 102)):  # of the five nearest
    assert captions(frames, fps).natural_frames("a person walks") == int(expected)
  assert captions((), fps).natural_frames("a person walks") is None


def test_what_captions_say_and_what_they_lack():
  known = captions()
  assert known.nearest("a person waves", 2)[0] == ("a person waves", 100) and len(known.nearest("walks", 9)) == 3
  assert known.knows("someone walks") and not known.knows("a person walks and waves")
  assert known.unknown_words("a person jogs, walks and sneaks") == ["sneaks"]


def test_without_captions_the_text_encoder_decides(tiny_run, tmp_path):
  none = captions(())
  assert not none and none.nearest("walks") == [] and not none.knows("walks")
  assert none.unknown_words("a person walks") == ["walks"]
  shutil.copytree(tiny_run, tmp_path / "run")
  (tmp_path / "run" / "captions.json").unlink()
  assert not load(tmp_path / "run").captions and load(tiny_run).captions


def test_the_subject_makes_no_difference_to_a_length():
  texts = [*["the cat sits"] * 3, "a person walks", "a person waves", "a person runs"]
  known = TrainingCaptions(texts, (1000, 113, 114, 100, 101, 102), Encoder(), 20.0)
  for who in ("a person", "she", "A woman", "someone", "the man"):
    assert known.natural_frames(f"{who} waves") == 102
  assert of_a_person("an old man bows") == "an old man bows"
