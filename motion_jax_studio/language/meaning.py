"""Replaces verbs by those that a model knows: one mechanism for synonyms and for kinds of an action.

  Meanings(captions, encoder).of("retreat")  ->  Meaning("walk", ("backward",), 0.85)

A model knows the verbs of its training captions. Any other verb is replaced by the known verb with the most similar
features of the text encoder or, if the encoder has not learned it, by the most certain verb of WordNet
(`motion_jax.text.wordnet`). The captions must have words for its manner: "amble" becomes "walk slowly", while "tiptoe"
does not become "walk". Below the confidence `SURE` the model gets the words as they are.
"""
import collections
import functools
from collections.abc import Iterable
from typing import Any, NamedTuple

from motion_jax.text import wordnet
from motion_jax.text.encoder import SYNONYM
from motion_jax.text.lexicon import ACTIONS, VERBS
from motion_jax.text.morphology import is_participle, possible_bases, present_participle, third_person, verb_of
from motion_jax.text.wordnet import Target
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.parts import part_of
from motion_jax_studio.language.words import letters

SURE = SYNONYM  # confidence from which a verb is replaced
_CLOSE = 0.2  # most that the confidence of a kind may be below that of the best target
_ENOUGH, _WELL = 3, 20  # least captions with a verb that a model knows, and that it knows well
_HELD_SECONDS = 1.5  # of a pose such as a crouch, where no time is given
_PLAIN = frozenset("slowly quickly forward backward".split())  # words of manner that every model's captions have
_NO_TARGETS = frozenset(VERBS[""]) | frozenset(
    "do perform play practice take get put place hold go come move cover".split())


_NO_LEGS = VERBS["arms"] | VERBS["torso"] | VERBS["head"] | VERBS[""]  # swings, also of the body
_OBJECTS = frozenset("it them him her".split())
_DIRECTIONS = frozenset("forward forwards ahead along back backward backwards sideways up down left right around away"
                  .split())


class Meaning(NamedTuple):
  """The known verb that replaces another, the words of manner and direction to add, and the confidence (0 to 1)."""
  verb: str
  manner: tuple[str, ...]
  confidence: float


@functools.lru_cache(maxsize=1 << 12)
def _stands_for(verb):
  return (lexicon.OWN_MEANINGS[verb],) if verb in lexicon.OWN_MEANINGS else wordnet.targets(verb)


@functools.lru_cache(maxsize=1 << 12)
def kind_of(verb: str, *kinds: str) -> Target | None:
  """Which of `kinds` a verb belongs to, with its manner: walk and "slowly" for "stroll"; None if it is none of them."""
  if verb in kinds:
    return Target(verb, 1.0)
  targets = () if verb in _NO_LEGS else _stands_for(verb)
  return next((target for target in targets if target.verb in kinds and (
      target.confidence >= max(SURE, targets[0].confidence - _CLOSE))), None)


def is_a(verb: str, *kinds: str) -> bool:
  """Whether a verb is one of `kinds` or a kind of it, as "sprint" is of "run"."""
  return kind_of(verb, *kinds) is not None


def pace_of(word: str) -> str:
  """"quickly" or "slowly" for an adjective or adverb of pace, as brisk and leisurely are; "" for another word."""
  return lexicon.OWN_PACES[word] if word in lexicon.OWN_PACES else wordnet.pace_of(word)


class Meanings:
  """The verbs of a model's training captions, and the replacements of other verbs."""

  def __init__(self, captions: Iterable[str], encoder: Any) -> None:
    self._captions, self._encoder = captions, encoder

  @functools.cached_property
  def words(self) -> collections.Counter:
    """{word: how often captions have it}."""
    return collections.Counter(letters(" ".join(self._captions)))

  @functools.cached_property
  def verbs(self) -> collections.Counter:
    """{verb: how often captions name it}, of those that they name often enough: the actions that the model knows."""
    counts: collections.Counter = collections.Counter()
    for word, count in self.words.items():
      counts[verb_of(word)] += count
    return collections.Counter({verb: count for verb, count in counts.items() if verb and count >= _ENOUGH})

  @functools.lru_cache(maxsize=1 << 10)  # noqa: B019  (as long as the model lives)
  def of(self, verb: str) -> Meaning | None:
    """The replacement of a verb in base form; None for a verb that the model knows, and for one without a match."""
    if verb in self.verbs or verb in _NO_TARGETS or not self._targets:
      return None
    known = self.verbs if verb in lexicon.OWN_MEANINGS else self._targets
    table = [target for target in _stands_for(verb) if target.verb in known]
    forms = {verb, third_person(verb), present_participle(verb)}
    if verb not in lexicon.OWN_MEANINGS and not forms.isdisjoint(self._encoder.known_words):
      near = verb_of(self._encoder.synonym(third_person(verb), [third_person(target) for target in self._targets]))
      table = [Target(near, SYNONYM, target.manner) for target in table if target.verb == near] or [
          Target(near, SYNONYM)]
    candidates = [target for target in table if target.verb and self._says(target.manner)]
    best = max(candidates, key=lambda target: target.confidence, default=None)
    return None if best is None or best.confidence < SURE else Meaning(best.verb, best.manner, best.confidence)

  @functools.cached_property
  def _targets(self):
    return sorted(verb for verb, count in self.verbs.items() if count >= _WELL and verb in ACTIONS - _NO_TARGETS)

  def _says(self, manner):
    """Whether captions have words for a manner."""
    return all(word in _PLAIN or word == lexicon.HELD or any(form in self.words for form in possible_bases(word))
               for word in manner)


def translated(clause: Any, meanings: Meanings | None) -> Any:
  """The clause in the words that a model knows: "retreats to the door" becomes "walks backward to the door"."""
  meaning = meanings.of(clause.verb) if meanings is not None else None
  if meaning is None or part_of(meaning.verb, clause.words) != part_of(meaning.verb, ()):  # "rotates the wrists"
    return clause
  if part_of(meaning.verb, ()) == "legs" and clause.words and (
      clause.words[0] in lexicon.POSSESSIVES | {"it", "them", "something", "someone", "somebody"}):
    return clause  # "returns his left foot"
  if lexicon.HELD in meaning.manner:  # the verb stays, for the rules of held poses need it
    form = present_participle(meaning.verb) if is_participle(clause.form) else third_person(meaning.verb)
    return clause._replace(form=form, reworded=True, seconds=clause.seconds or _HELD_SECONDS)
  clause_words = {*clause.before, *clause.words}
  directions = [word for word in meaning.manner if word in _DIRECTIONS and clause_words.isdisjoint(_DIRECTIONS)]
  manner = [word for word in meaning.manner if word not in _DIRECTIONS and not any(map(pace_of, clause_words))]
  form = present_participle(meaning.verb) if is_participle(clause.form) else meaning.verb
  first = next((at for at, word in enumerate(clause.words) if word not in _DIRECTIONS | _OBJECTS), len(clause.words))
  words = [*directions, *clause.words[:first], *manner, *clause.words[first:]]  # "walks backward slowly to the door"
  return clause._replace(verb=meaning.verb, form=form, words=words, reworded=True)
