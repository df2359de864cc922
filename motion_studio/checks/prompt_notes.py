"""What a person should know of a prompt before a motion is made of it: what the model has not learned, what it makes
instead, what it can do, and that there is one body only."""
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from motion_jax.text.morphology import possible_bases
from motion_jax.text.vocabulary import closest_word

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel

_NAMED = 5  # words of a prompt, and prompts of a call, that are named
_PEOPLE = r"(?:people|persons|men|women|boys|girls|guys|kids|children|friends|dancers|fighters|boxers|figures|players)"
_SEVERAL = re.compile(
    rf"\b(?:two|three|four|five|six|ten|several|some|many|both|a (?:couple|group|pair|crowd) of) (?:\w+ )?{_PEOPLE}\b|"
    rf"^(?:the |some )?{_PEOPLE}\b|\beach other\b|\bone another\b|\banother (?:person|man|woman|guy|boy|girl|figure)\b|"
    r"\b(?:a|the|one) (?:\w+ )?(?:man|woman|person|boy|girl) and (?:a|the|another|one) (?:\w+ )?"
    r"(?:man|woman|person|boy|girl)\b|\b(?:his|her|their|a|the) (?:partner|opponent|friend)\b", re.IGNORECASE)


def notes_of(model: "TextToMotionModel", prompts: Iterable[str], literal: bool = False) -> list[str]:
  """Sentences about prompts that a model may not do as they are meant. literal: they are given to the model whole, and
  not action by action."""
  notes: dict[str, None] = {}
  named: set[str] = set()
  for prompt in prompts:
    if found := _SEVERAL.search(prompt):
      notes[f"{shortened(prompt)} is about several people ({found[0]!r}); only one body is made"] = None
    for said in [prompt] if literal else model.understand(prompt).prompts:
      words = [word for word in model.unknown_words(said) if word.lower() not in named]  # each once
      named.update(map(str.lower, words))
      if note := _of_words(model, said, words) if words else "" if literal else _of_phrase(model, said):
        notes[note] = None
  more = len(notes) - _NAMED
  return [*notes] if more <= 0 else [
      *[*notes][:_NAMED], f"the model does not know some words or actions of {more} more prompts"]


def _of_words(model, said, words):
  """A note of words that stand in no caption that the model learned from."""
  found = ", ".join(with_suggestion(model, word) for word in words[:_NAMED]) + " ..." * (len(words) > _NAMED)
  nearest = model.nearest_captions(said)
  instead = (f"no caption that {model.folder.name} learned from says so; the nearest of them is "
             f"{shortened(nearest[0][0])}" if nearest else "it may be ignored or misunderstood")
  return f"the model does not know {found} in {shortened(said)}: {instead}{_can_do(model, said)}"


def _of_phrase(model, said):
  """A note of an action whose words are known, but not what they say together; "" of one that the model knows."""
  if model.repertoire is None or model.knows(said):
    return ""
  found = model.repertoire.judge(said)
  if found.known and not found.few or not found.nearest:
    return ""
  learned = "learned little like" if found.known else "not learned"
  return (f"{model.folder.name} has {learned} {shortened(said)}; what it knows nearest is "
          f"{shortened(found.nearest[0][1])}, so expect something like that{_can_do(model, said)}")


def _can_do(model, said):
  if model.repertoire is None or not (found := model.repertoire.suggestions(said)):
    return ""
  return f"; it can do, for example, {', '.join(map(repr, found))}"


def with_suggestion(model: Any, word: str) -> str:
  """The word in quotes, and what was meant where it is misspelled: no word of the encoder's, but like a known one."""
  known = sorted(model.encoder.known_words)
  if vocabulary := model.vocabulary:
    known = sorted({*vocabulary.words, *(one for one in known if not vocabulary.missing(one))})
  other = "" if any(map(model.encoder.is_piece, possible_bases(word.lower()))) else closest_word(word, known)
  return f"{word!r} (did you mean {other!r}?)" if other else repr(word)


def shortened(text: str) -> str:
  """The text in quotes, cut where it is long."""
  return repr(text if len(text) <= 120 else text[:119] + "…")
