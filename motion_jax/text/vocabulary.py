"""The words of the captions that a model learned from, and which words of a sentence are none of them."""
import difflib
import functools
import heapq
import re
from collections.abc import Callable, Iterable

from motion_jax.text.captions import without_subject
from motion_jax.text.lexicon import DETERMINERS, FUNCTION_WORDS, NAMES, WORDS_WITHOUT_MOTION
from motion_jax.text.morphology import possible_bases, verb_of

_FEW = 500  # captions that are read with the encoder to find the nearest; more are first sifted by their words


def content_words(sentence):
  """The words of a sentence that say something of a movement, as they stand there; numbers are none."""
  return [word for word in re.findall(r"[^\W\d_]+", sentence) if word.lower() not in FUNCTION_WORDS]


def unknown_words(sentence: str, is_known: Callable[[str], bool]) -> list[str]:
  """The words of a sentence that are worth a warning, in order, each once in whatever form: is_known(word in small
  letters) says no, and they are neither names of who moves nor words that add nothing to a motion."""
  found: dict[str, str] = {}
  words = re.findall(r"[^\W\d_]+", sentence)
  for before, word, after in zip(["", *words], words, [*words[1:], ""]):
    lower = word.lower()
    if lower not in WORDS_WITHOUT_MOTION and not _is_name(before, word, after) and not is_known(lower) and not any(
        form in found for form in possible_bases(lower)):
      found |= dict.fromkeys(possible_bases(lower), word)
  return list(dict.fromkeys(found.values()))


def _is_name(before, word, after):
  """Whether a word is the name of who moves: a usual one, or with a capital letter and a verb after it."""
  if word.lower() in NAMES:
    return True
  begins_sentence = not before
  return word.istitle() and not begins_sentence and (before.lower() in ("named", "called") or (
      before.lower() not in DETERMINERS and after.islower() and (after in ("is", "was") or (
          after.endswith(("s", "ed")) and bool(verb_of(after))))))


def closest_word(word: str, known: Iterable[str]) -> str:
  """The known word that a misspelled one is most like, "" where none is like it: wlaks -> walks."""
  lower = word.lower()
  near = difflib.get_close_matches(lower, [one for one in known if one[:1] == lower[:1]], 1, 0.8)
  return near[0] if near and len(lower) > 3 else ""


class Vocabulary:
  """What the captions of a training set say: which words, and which captions a sentence shares words with."""

  def __init__(self, captions, also=()):
    """also: what was said besides, such as other words for who moves, in no caption's row."""
    self.captions, self._also = list(captions), tuple(also)

  @functools.cached_property
  def _rows(self):
    """{form of a word: rows of the captions that have it}; a model that is asked in known words only never needs it."""
    rows = {form: [] for word in content_words(" ".join(self._also).lower()) for form in possible_bases(word)}
    for row, caption in enumerate(self.captions):
      for form in {form for word in content_words(caption.lower()) for form in possible_bases(word)}:
        rows.setdefault(form, []).append(row)
    return rows

  @functools.cached_property
  def _said(self):
    return {without_subject(caption) for caption in self.captions}

  def holds(self, sentence):
    """Whether a caption says this, of any subject."""
    return without_subject(sentence) in self._said

  def missing(self, sentence):
    """The words of a sentence that stand in no caption, in any form, each once and in order; none that add nothing to
    a motion, such as "please", "Mary" or "metres"."""
    return unknown_words(sentence, lambda word: any(form in self._rows for form in possible_bases(word)))

  @functools.cached_property
  def words(self):
    """The words of the captions that say something of a movement, in small letters and in order."""
    return sorted({word for caption in (*self.captions, *self._also) for word in content_words(caption.lower())})

  def candidates(self, sentence, most=_FEW):
    """Rows of at most so many captions: those that share words with a sentence, rare ones above all."""
    if len(self.captions) <= 10 * most:
      return list(range(len(self.captions)))
    weight = {}
    for word in content_words(sentence.lower()):
      found = set().union(*(self._rows.get(form, ()) for form in possible_bases(word)))
      for row in found:
        weight[row] = weight.get(row, 0.0) + 1 / len(found)
    # Of captions that share equally much those with few other words come first, then those in front.
    key = lambda row: (weight[row], -len(self.captions[row]), -row)
    shared = heapq.nlargest(most, weight, key=key)
    return sorted(shared) or list(range(0, len(self.captions), len(self.captions) // most))[:most]
