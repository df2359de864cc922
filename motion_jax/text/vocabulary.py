"""The vocabulary of training captions, and words of a prompt that are not in it."""
import functools
import heapq
import re
from collections.abc import Callable, Iterable

from motion_jax.text.captions import without_subject
from motion_jax.text.lexicon import DETERMINERS, FUNCTION_WORDS, NAMES, WORDS_WITHOUT_MOTION
from motion_jax.text.morphology import possible_bases, verb_of

_FEW = 500  # captions that the encoder compares with a prompt; more are first filtered by shared words


def content_words(sentence):
  """The words of a sentence without function words and numbers."""
  return [word for word in re.findall(r"[^\W\d_]+", sentence) if word.lower() not in FUNCTION_WORDS]


def unknown_words(sentence: str, is_known: Callable[[str], bool]) -> list[str]:
  """Unknown words of a sentence, in order; inflected forms of one word are listed once.

  is_known: whether a word in lower case is known. Names of persons and words without movement ("please", "metres") are
  never listed.
  """
  unknown: dict[str, str] = {}
  words = re.findall(r"[^\W\d_]+", sentence)
  for before, word, after in zip(["", *words], words, [*words[1:], ""]):
    lower = word.lower()
    if lower not in WORDS_WITHOUT_MOTION and not _is_name(before, word, after) and not is_known(lower) and not any(
        form in unknown for form in possible_bases(lower)):
      unknown |= dict.fromkeys(possible_bases(lower), word)
  return list(dict.fromkeys(unknown.values()))


def _is_name(before, word, after):
  """Whether a word is the name of a person: a common one, or one with a capital letter and a verb after it."""
  if word.lower() in NAMES:
    return True
  begins_sentence = not before
  return word.istitle() and not begins_sentence and (before.lower() in ("named", "called") or (
      before.lower() not in DETERMINERS and after.islower() and (after in ("is", "was") or (
          after.endswith(("s", "ed")) and bool(verb_of(after))))))


def closest_word(word: str, known: Iterable[str]) -> str:
  """The known word closest to a misspelled one, "" if none is close: wlaks -> walks."""
  lower = word.lower()
  import difflib
  near = difflib.get_close_matches(lower, [candidate for candidate in known if candidate[:1] == lower[:1]], 1, 0.8)
  return near[0] if near and len(lower) > 3 else ""


class Vocabulary:
  """The words of a training set's captions, and the captions that share words with a sentence."""

  def __init__(self, captions, also=()):
    """also: further text of the training, such as the subjects that captions are varied with."""
    self.captions, self._also = list(captions), tuple(also)

  @functools.cached_property
  def _rows(self):
    """{base form of a word: rows of the captions that have it}, computed when a prompt has an unknown word."""
    rows = {form: [] for word in content_words(" ".join(self._also).lower()) for form in possible_bases(word)}
    for row, caption in enumerate(self.captions):
      for form in {form for word in content_words(caption.lower()) for form in possible_bases(word)}:
        rows.setdefault(form, []).append(row)
    return rows

  @functools.cached_property
  def _phrases(self):
    return {without_subject(caption) for caption in self.captions}

  def holds(self, sentence):
    """Whether a caption equals the sentence, ignoring the subject."""
    return without_subject(sentence) in self._phrases

  def missing(self, sentence):
    """The words of a sentence that occur in no caption in any form (`unknown_words`)."""
    return unknown_words(sentence, lambda word: any(form in self._rows for form in possible_bases(word)))

  @functools.cached_property
  def words(self):
    """The content words of the captions, in lower case, sorted."""
    return sorted({word for caption in (*self.captions, *self._also) for word in content_words(caption.lower())})

  def candidates(self, sentence, most=_FEW):
    """Rows of at most `most` captions that share words with a sentence; rare words weigh more."""
    if len(self.captions) <= 10 * most:
      return list(range(len(self.captions)))
    weight = {}
    for word in content_words(sentence.lower()):
      matches = set().union(*(self._rows.get(form, ()) for form in possible_bases(word)))
      for row in matches:
        weight[row] = weight.get(row, 0.0) + 1 / len(matches)
    # Ties: shorter captions first, then earlier ones.
    key = lambda row: (weight[row], -len(self.captions[row]), -row)
    shared = heapq.nlargest(most, weight, key=key)
    return sorted(shared) or list(range(0, len(self.captions), len(self.captions) // most))[:most]
