"""The repertoire of a model: the phrases of its training captions, and how close a prompt is to them.

Known words alone mean little ("stretches" occurs in a caption about a zombie's arms), so a prompt is judged as a whole
phrase: by its sentence vector, and by the verbs of the nearest phrases.
"""
import collections
import functools
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from motion_jax.text.captions import without_subject
from motion_jax.text.lexicon import WORDS_WITHOUT_MOTION
from motion_jax.text.morphology import base_form, possible_bases, verb_of
from motion_jax.text.tagger import tag_words
from motion_jax.utils import cache
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.hand_places import without_hands
from motion_jax_studio.language.meaning import kind_of
from motion_jax_studio.language.parser import parse
from motion_jax_studio.language.parts import limb_postures
from motion_jax_studio.language.plan import Plan

# Least cosine of two phrases with the same meaning. In a shipped model 1.5 to 1.7 % of the phrases have no other one as
# near as this; figures for prompts by people: docs/sentences.md.
NEAR = 0.75
_FEW, _EQUAL = 2, 0.9  # a phrase with at most _FEW near phrases is hardly learned, unless the nearest has this cosine
# A word is rare if at most _RARE phrases have it (mirrored copies included), and at most this share of all phrases.
_RARE, _RARE_SHARE = 5, 0.01
_SUBJECT = re.compile(r"^(?:(?:a|an|the|one) (?:[\w'-]+ ){0,3}?(?:person|man|woman|figure|human|dancer|character)|"
                      r"someone|somebody|he|she|they) ")
_SEVERAL = re.compile(r"\b(?:then|after that|followed by)\b")
_MANNER = re.compile(
    r",? ?\b(?:(?:very |quite |really )?(?:slowly|quickly|fast|rapidly|happily|sadly|angrily|tiredly|proudly|"
    r"energetically|stealthily|casually|calmly|leisurely|gently|carefully)|at an? [\w-]+ (?:pace|speed)|"
    r"in a normal way|once|twice|thrice|(?:two|three|four|five|six|seven|eight|nine|ten|\d+) times(?: in a row)?|"
    r"for (?:a|one|two|three|four|five|six|ten|\d+) (?:moment|while|seconds?|minutes?))\b")
_NO_THINGS = set("circle circles direction middle right left "
                 "arm hand wrist elbow fist finger shoulder leg knee foot feet heel toe ankle thigh head chin neck "
                 "torso hip waist chest body back face spot place side way air time direction line person".split())
_NO_DEEDS = (lexicon.LIGHT_VERBS | lexicon.DIRECTIONS | lexicon.LIMBS | WORDS_WITHOUT_MOTION | set(lexicon.ASPECTS)
             | set("forth level go come use follow end switch".split())
             | {verb for verb, meaning in lexicon.OWN_MEANINGS.items() if lexicon.LOST not in meaning.manner})
# Where an action takes place: over, under or up a thing; a hand at the face.
_OVER = re.compile(r"\b(over|onto|under|through|across|into|off|up|down) (?:(?:and|on|onto|over) )*"
                   r"(?:(something|it)|(?:an?|the|some) (?:\w+ )?(\w+))\b")
_AT_A_PART = re.compile(r"\b(?:to|at|on|onto|near|against|over|of|behind|around) (?:(?:the|his|her|their|its|a|one) )?"
                        r"(head|face|mouth|ears?|hips?|chest|stomach|chin|eyes?|nose)\b(?! level)")
_UNNAMED = re.compile(r"\b(?:something|(?:an?|the|some) (?:object|thing|item))\b")
_OVER_THE_HEAD = re.compile(r"\b(?:over|above) (?:(?:the|his|her|their|its) )?heads?\b")
# Direction and height of a jump or a kick, but not of a named limb.
_WAY = re.compile(r"(?<!with )(?<!with the )\b(left|right|backward|sideways|low|high)s?\b"
                  rf"(?! (?:and \w+ )?(?:{'|'.join(sorted(lexicon.LIMBS))})\b)")
_LEAPS = ("jump", "hop", "leap", "kick")
_TOKEN = re.compile("[a-z'-]+")
_WALKS = {"go", "move", "step"}


class Judgement(NamedTuple):
  """Whether a model knows a phrase."""
  known: bool
  few: bool  # known from few phrases
  nearest: list[tuple[float, str]]  # (cosine, phrase), the nearest first


def phrase_of(sentence: str) -> str:
  """A sentence without its subject, pace and repetitions: "a man walks slowly twice" -> "walks"."""
  words = _MANNER.sub("", _SUBJECT.sub("", without_subject(sentence) + " ").strip())
  return " ".join(words.replace(" ,", ",").split()).strip(" ,.")


class Repertoire:
  """The phrases of a model's training captions of one action, and their sentence vectors."""

  def __init__(self, captions: Iterable[str], encoder: Any) -> None:
    self._encoder = encoder
    phrases = (phrase_of(caption) for caption in captions if not _SEVERAL.search(caption.lower()))
    self.phrases = sorted({phrase for phrase in phrases if phrase and not phrase.startswith(("a ", "an ", "the "))})

  @functools.cached_property
  def _vectors(self):
    sentences = [f"a person {phrase}" for phrase in self.phrases]
    key = cache.key_of("sentences", self._encoder.fingerprint, *sentences)
    return cache.kept_array("sentences", key, lambda: self._encoder.many_sentences(sentences))

  @functools.cached_property
  def _words(self):
    """{base form: number of phrases in which it may stand}."""
    return collections.Counter(form for phrase in self.phrases
                               for form in {form for word in _TOKEN.findall(phrase) for form in possible_bases(word)})

  def rare_words(self, action: str | Plan) -> dict[str, int]:
    """{word: number of phrases with it} of the rare verbs and nouns of an action, such as "cartwheel"."""
    phrase = phrase_of(action if isinstance(action, str) else action.text).lower()
    most = min(_RARE, _RARE_SHARE * len(self.phrases))
    counts = {word: max(self._words[form] for form in possible_bases(word)) for word in _deeds(phrase)}
    return {word: count for word, count in counts.items() if 0 < count <= most}

  def nearest(self, sentence: str, num: int) -> list[tuple[float, str]]:
    """[(cosine, phrase)] of the phrases closest in meaning, the nearest first."""
    if not self.phrases:
      return []
    nearness = self._vectors @ self._encoder.sentence([f"a person {phrase_of(sentence)}"])[0]
    return [(float(nearness[row]), self.phrases[row]) for row in np.argsort(-nearness, kind="stable")[:num]]

  def judge(self, action: str | Plan) -> Judgement:
    """Judge one action, given as a plan of one action or as a prompt."""
    plan = parse(action) if isinstance(action, str) else action
    sentence = plan.text
    nearest = self.nearest(sentence, 40)
    near = [phrase for cosine, phrase in nearest if cosine >= NEAR]
    kinds = _kinds(plan.actions)
    same = not kinds or any(kinds & _verbs_of(phrase) for phrase in near)
    prompt_phrase = phrase_of(sentence)
    # Only words that captions have are compared; all others get notes of their own (`checks.prompt_notes`).
    things = (_things(prompt_phrase) & self._words.keys()) | _places(prompt_phrase)
    if any(action.verb in _LEAPS for action in plan.actions):
      things |= _ways(prompt_phrase)
    if not any(action.part == "arms" or action.verb in lexicon.LIMB_OF_ACTION for action in plan.actions):
      things |= limb_postures(prompt_phrase)  # not for "waves with the right hand up"
    if _UNNAMED.search(prompt_phrase) and any(action.part == "arms" for action in plan.actions):
      things |= {"thing"}  # "throws an object"
    alike = [phrase for phrase in near
             if things <= _things(phrase) | _places(phrase) | _ways(phrase) | limb_postures(phrase)]
    equal = bool(alike) and nearest[0][0] >= _EQUAL and nearest[0][1] == alike[0]
    few = len(alike) <= _FEW and not equal or bool(self.rare_words(plan))
    return Judgement(bool(near) and same, bool(near) and few, nearest)


@functools.lru_cache(maxsize=1 << 12)
def _deeds(phrase):
  """Verbs and nouns of a phrase as they are written, without body parts, directions and hand poses: the action, its
  object, and a character that is imitated."""
  words = _TOKEN.findall(without_hands(phrase))
  return [word for word, (base, tag) in zip(words, tag_words(words)) if tag in ("VERB", "NOUN") and not (
      {base, word} & _NO_DEEDS or base_form(word, _NO_THINGS))]


@functools.lru_cache(maxsize=1 << 12)
def _things(phrase):
  """Nouns of a phrase in base form, without body parts: objects that are kicked, climbed, opened."""
  tagged = tag_words(phrase.split())
  return frozenset(word for word, tag in tagged if tag == "NOUN" and not verb_of(word) and word not in _NO_THINGS)


@functools.lru_cache(maxsize=1 << 12)
def _places(phrase):
  """Where the action of a phrase takes place, other than on the ground: {"over"} a thing, at the {"face"}."""
  phrase = _OVER_THE_HEAD.sub("", phrase)
  things = ((match[1], match[2] or match[3]) for match in _OVER.finditer(phrase))
  over = {"over" if how == "across" else how for how, thing in things if not base_form(thing, _NO_THINGS)}
  return frozenset(over | {match[1].removesuffix("s") for match in _AT_A_PART.finditer(phrase)})


@functools.lru_cache(maxsize=1 << 12)
def _ways(phrase):
  """Direction and height of the action of a phrase, but not of a named limb: {"left"} of "jumps to the left"."""
  return frozenset(_WAY.findall(phrase))


@functools.lru_cache(maxsize=1 << 12)
def _verbs_of(phrase):
  """The kinds of verbs of a training caption's phrase."""
  return _kinds(parse(f"a person {phrase}").actions)


def _kinds(actions):
  """Verbs of actions, without light verbs; all kinds of walking count as one verb, and so do all kinds of running.

  "raise" and "lift" include the body part: lifting a knee is not lifting a hand.
  """
  verbs = {action.verb for action in actions} - {"", *lexicon.LIGHT_VERBS}
  kinds = {verb: kind_of(verb, "walk", "run") for verb in verbs}
  moved = {action.verb: f"{action.verb} {action.part}" for action in actions if action.verb in ("raise", "lift")}
  return frozenset("walk" if verb in _WALKS else kind.verb if kind else moved.get(verb, verb)
                   for verb, kind in kinds.items())
