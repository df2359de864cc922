"""What a model can do, by the captions that it learned from: phrases of one action each, and how near a prompt is.

A single known word says little ("stretches" stands in a caption about a zombie's arms), so a prompt is judged as a
whole phrase: by the sentence vectors of the text encoder, and by the verbs of the phrases that come nearest.
"""
import functools
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from motion_jax.text.captions import without_subject
from motion_jax.text.morphology import possible_bases, verb_of
from motion_jax.text.tagger import tag_words
from motion_jax.utils import cache
from motion_studio.language import lexicon
from motion_studio.language.parser import parse

# Cosine from which on a phrase means the same as a known one. Of the phrases of the models that ship, each compared
# with all others of its own model, 1.5 to 1.7 % have none so near; captions by people: docs/sentences.md.
NEAR = 0.75
_FEW, _EXACT = 2, 0.9  # a phrase with fewer near ones and no equal (cosine) counts as hardly learned
_SUBJECT = re.compile(r"^(?:(?:a|an|the|one) (?:[\w'-]+ ){0,3}?(?:person|man|woman|figure|human|dancer|character)|"
                      r"someone|somebody|he|she|they) ")
_SEVERAL = re.compile(r"\b(?:then|after that|followed by)\b")
_MANNER = re.compile(
    r",? ?\b(?:(?:very |quite |really )?(?:slowly|quickly|fast|rapidly|happily|sadly|angrily|tiredly|proudly|"
    r"energetically|stealthily|casually|calmly|leisurely|gently|carefully)|at an? [\w-]+ (?:pace|speed)|"
    r"in a normal way|once|twice|thrice|(?:two|three|four|five|six|seven|eight|nine|ten|\d+) times(?: in a row)?|"
    r"for (?:a|one|two|three|four|five|six|ten|\d+) (?:moment|while|seconds?|minutes?))\b")
_NO_THINGS = set("arm hand wrist elbow fist finger shoulder leg knee foot feet heel toe ankle thigh head chin neck "
                 "torso hip waist chest body back face spot place side way air time direction line person".split())
_WALKS = {"walk", "stroll", "go", "move", "step", "stride"}


class Judgement(NamedTuple):
  """How a phrase stands to what a model learned: whether it is known, known from few phrases alone, and the nearest."""
  known: bool
  few: bool
  nearest: list[tuple[float, str]]  # (cosine, phrase), the nearest first


def phrase_of(sentence: str) -> str:
  """What a sentence says is done, without who does it, how fast and how often."""
  words = _MANNER.sub("", _SUBJECT.sub("", without_subject(sentence) + " ").strip())
  return " ".join(words.replace(" ,", ",").split()).strip(" ,.")


class Repertoire:
  """The phrases of one action each that a model's captions say, and their sentence vectors."""

  def __init__(self, captions: Iterable[str], encoder: Any) -> None:
    self._encoder = encoder
    found = (phrase_of(caption) for caption in captions if not _SEVERAL.search(caption.lower()))
    self.phrases = sorted({phrase for phrase in found if phrase and not phrase.startswith(("a ", "an ", "the "))})

  @functools.cached_property
  def _vectors(self):
    sentences = [f"a person {phrase}" for phrase in self.phrases]
    key = cache.key_of("sentences", self._encoder.fingerprint, *sentences)
    return cache.kept_array("sentences", key, lambda: self._encoder.many_sentences(sentences))

  @functools.cached_property
  def _words(self):
    return frozenset(form for phrase in self.phrases for word in phrase.split() for form in possible_bases(word))

  def nearest(self, sentence: str, num: int) -> list[tuple[float, str]]:
    """[(cosine, phrase)] of the phrases that mean nearly the same, the nearest first."""
    if not self.phrases:
      return []
    nearness = self._vectors @ self._encoder.sentence([f"a person {phrase_of(sentence)}"])[0]
    return [(float(nearness[row]), self.phrases[row]) for row in np.argsort(-nearness, kind="stable")[:num]]

  def judge(self, sentence: str) -> Judgement:
    """How a sentence of one action stands to the phrases."""
    nearest = self.nearest(sentence, 40)
    near = [phrase for cosine, phrase in nearest if cosine >= NEAR]
    own = _verbs(sentence)
    same = not own or any(own & _verbs(f"a person {phrase}") for phrase in near)
    things = _things(phrase_of(sentence)) & self._words  # what no caption names is told as an unknown word
    alike = [phrase for phrase in near if things <= _things(phrase)]
    return Judgement(bool(near) and same, bool(near) and len(alike) <= _FEW and nearest[0][0] < _EXACT, nearest)

  def suggestions(self, sentence: str, num: int = 3) -> list[str]:
    """The nearest phrases with different verbs, behind the very nearest: what the model can do instead."""
    found: dict[str, str] = {}
    for _, phrase in self.nearest(sentence, 200)[1:]:
      verb = phrase.split()[0] if not phrase.startswith("is ") else phrase.split()[1]
      if len(phrase) <= 60:
        found.setdefault(verb.removesuffix("ing"), phrase)
      if len(found) == num:
        break
    return list(found.values())


@functools.lru_cache(maxsize=1 << 12)
def _things(phrase):
  """The nouns of a phrase in base form, no parts of the body among them: what is kicked, climbed, opened."""
  tagged = tag_words(phrase.split())
  return frozenset(word for word, tag in tagged if tag == "NOUN" and not verb_of(word) and word not in _NO_THINGS)


@functools.lru_cache(maxsize=1 << 12)
def _verbs(sentence):
  """The verbs of a sentence in base form; of walks and of runs one each."""
  verbs = {action.verb for action in parse(sentence).actions} - {"", *lexicon.LIGHT_VERBS}
  return frozenset("walk" if verb in _WALKS else "run" if verb in lexicon.RUNNING_VERBS else verb for verb in verbs)
