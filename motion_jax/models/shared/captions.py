"""Statistics of training captions: those near a prompt, the lengths of their clips, and words that they lack."""
import functools
import hashlib
import os
import pathlib
import re
import unicodedata
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from motion_jax.text.captions import of_a_person
from motion_jax.text.encoder import TextEncoder
from motion_jax.text.lexicon import FUNCTION_WORDS
from motion_jax.text.vocabulary import Vocabulary
from motion_jax.training import checkpoint
from motion_jax.utils import cache

_SHORTEST, _LONGEST = 3.0, 9.8  # seconds of a usual length
_NEAR = 5  # captions whose lengths count


class TrainingCaptions:
  """Statistics of training captions. Empty, and false, where a run folder does not keep them.

  texts: the captions; frames: the usual length of each one's clips. A caption counts with any of `subjects` in the
  place of its own, where training varied them. Answers about a prompt are cached, those of `of_folder` also on disk.
  """

  def __init__(self, texts: Sequence[str], frames: Sequence[int], encoder: TextEncoder, fps: float = 20.0,
               subjects: Sequence[str] = ()) -> None:
    self._rows: Any = (list(texts), frames)
    self._folder: str | os.PathLike = ""
    self._any = len(texts) > 0
    self._encoder, self._fps, self._subjects, self._answers = encoder, fps, subjects, cache.Answers()

  @classmethod
  def of_folder(cls, folder: str | os.PathLike, encoder: TextEncoder, fps: float, subjects: Sequence[str] = ()) -> Self:
    """The statistics in a run folder, read when an answer is not in the user's cache; empty where there are none."""
    path = pathlib.Path(folder) / checkpoint.LENGTHS
    if not path.is_file():
      return cls([], [], encoder, fps, subjects)
    captions = cls([], [], encoder, fps, subjects)
    captions._rows, captions._any = None, True
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    captions._answers = cache.Answers("captions", digest, encoder.fingerprint, fps, *subjects)
    captions._folder = folder
    return captions

  @functools.cached_property
  def _read(self):
    return self._rows or checkpoint.load_lengths(self._folder)

  @property
  def texts(self) -> list[str]:
    return self._read[0]

  @property
  def frames(self) -> Sequence[int]:
    return self._read[1]

  @functools.cached_property
  def vocabulary(self) -> Vocabulary:
    """The words of the captions."""
    return Vocabulary(self.texts, self._subjects)

  def __len__(self) -> int:
    return len(self.texts)

  def __bool__(self) -> bool:
    return self._any

  def knows(self, prompt: str) -> bool:
    """Whether a caption is this prompt, with any subject."""
    return self._any and self._answers(f"knows {prompt}", lambda: self.vocabulary.holds(prompt))

  def nearest(self, prompt: str, num: int = 1) -> list[tuple[str, int]]:
    """[(caption, its usual frames)] of the captions with the most similar sentence vectors, the nearest first.

    Of many captions only those that share words with the prompt are compared.
    """
    if not self._any:
      return []
    captions = self._answers(f"nearest {num} {prompt}", lambda: self._nearest(prompt, num))
    return [(text, frames) for text, frames in captions]

  def _nearest(self, prompt, num):
    rows = self.vocabulary.candidates(prompt)
    vectors = (self._vectors if len(rows) == len(self.texts) else
               self._encoder.many_sentences([self.texts[row] for row in rows]))
    nearness = vectors @ self._encoder.sentence([prompt])[0]
    nearest = [rows[i] for i in np.argsort(-nearness, kind="stable")[:num]]
    return [[self.texts[row], np.asarray(self.frames[row]).item()] for row in nearest]

  @functools.cached_property
  def _vectors(self):
    key = cache.key_of("sentences", self._encoder.fingerprint, *self.texts)
    return cache.kept_array("sentences", key, lambda: self._encoder.many_sentences(self.texts))

  def natural_frames(self, prompt: str) -> int | None:
    """The median length of the clips of the five nearest captions, 3 to 9.8 seconds; None without captions.

    A prompt of any subject counts as one of "a person".
    """
    nearest = self.nearest(of_a_person(prompt), _NEAR)
    if not nearest:
      return None
    return int(np.clip(np.median([frames for _, frames in nearest]), _SHORTEST * self._fps, _LONGEST * self._fps))

  def unknown_words(self, prompt: str) -> list[str]:
    """Words of a prompt that stand in no caption, nor do words of the same meaning, and signs that the text encoder
    cannot read; without captions the words that the encoder does not know."""
    if not self._any:
      return self._encoder.out_of_vocabulary(prompt)
    return [*self._answers(f"unknown {prompt}", lambda: self._unknown(prompt))]

  def is_english(self, prompt: str) -> bool:
    """Whether a prompt may be English. It is not if most of its words are of another script, nor if it has several
    words, no "the", at most a quarter of them function words (a, then), and most of them unknown."""
    words = re.findall(r"[^\W\d_]+", prompt.lower())
    latin = sum(unicodedata.normalize("NFD", word)[0].isascii() for word in words)
    if 2 * latin < len(words):
      return False
    return (len(words) < 2 or "the" in words or 4 * sum(word in FUNCTION_WORDS for word in words) > len(words)
            or 2 * len(self.unknown_words(prompt)) <= len(words))

  def _unknown(self, prompt):
    return [word for word in self.vocabulary.missing(prompt)
            if not self._encoder.synonym(word, self.vocabulary.words)] + self._encoder.unreadable(prompt)
