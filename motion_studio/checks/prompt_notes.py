"""What a person should know of a prompt before a motion is made of it: what the model has not learned, what it makes
instead, what it can do, and that there is one body only."""
import re
from collections.abc import Iterable
from typing import Any

from motion_jax.text.morphology import possible_bases
from motion_jax.text.vocabulary import closest_word
from motion_studio.language import Plan

_NAMED = 5  # words of a prompt, and prompts of a call, that are named
_PEOPLE = r"(?:people|persons|men|women|boys|girls|guys|kids|children|friends|dancers|fighters|boxers|figures|players)"
_SEVERAL = re.compile(
    rf"\b(?:two|three|four|five|six|ten|several|some|many|both|a (?:couple|group|pair|crowd) of) (?:\w+ )?{_PEOPLE}\b|"
    rf"^(?:the |some )?{_PEOPLE}\b|\beach other\b|\bone another\b|\banother (?:person|man|woman|guy|boy|girl|figure)\b|"
    r"\b(?:a|the|one) (?:\w+ )?(?:man|woman|person|boy|girl) and (?:a|the|another|one) (?:\w+ )?"
    r"(?:man|woman|person|boy|girl)\b|\b(?:his|her|their|a|the) (?:partner|opponent|friend)\b", re.IGNORECASE)


def notes_of(planner: Any, prompts: Iterable[str | Plan]) -> list[str]:
  """Notes about prompts that a model may not do as they are meant; a plan is judged action by action, a prompt as a
  whole."""
  notes: dict[str, None] = {}
  named: set[str] = set()
  for one in prompts:
    prompt = one if isinstance(one, str) else one.text
    if found := _SEVERAL.search(prompt):
      notes[f"{shortened(prompt)} is about several people ({found[0]!r}); only one body is made"] = None
    for part in [prompt] if isinstance(one, str) else one.prompts:
      words = [word for word in planner.model.captions.unknown_words(part) if word.lower() not in named]  # each once
      named.update(map(str.lower, words))
      if note := _of_words(planner, part, words) if words else "" if isinstance(one, str) else _of_phrase(
          planner, part):
        notes[note] = None
  more = len(notes) - _NAMED
  return [*notes] if more <= 0 else [
      *[*notes][:_NAMED], f"the model does not know some words or actions of {more} more prompts"]


def _of_words(planner, prompt, words):
  """A note on words that stand in no training caption."""
  found = ", ".join(with_suggestion(planner.model, word) for word in words[:_NAMED]) + " ..." * (len(words) > _NAMED)
  nearest = planner.nearest_captions(prompt)
  instead = (f"no caption that {planner.model.folder.name} learned from says so; the nearest of them is "
             f"{shortened(nearest[0][0])}" if nearest else "it may be ignored or misunderstood")
  return f"the model does not know {found} in {shortened(prompt)}: {instead}{_can_do(planner, prompt)}"


def _of_phrase(planner, prompt):
  """A note on an action with known words in an unknown combination; "" for one that the model knows."""
  if planner.repertoire is None or planner.model.captions.knows(prompt):
    return ""
  found = planner.repertoire.judge(prompt)
  if found.known and not found.few or not found.nearest:
    return ""
  learned = "learned little like" if found.known else "not learned"
  return (f"{planner.model.folder.name} has {learned} {shortened(prompt)}; what it knows nearest is "
          f"{shortened(found.nearest[0][1])}, so expect something like that{_can_do(planner, prompt)}")


def _can_do(planner, prompt):
  if planner.repertoire is None or not (found := planner.repertoire.suggestions(prompt)):
    return ""
  return f"; it can do, for example, {', '.join(map(repr, found))}"


def with_suggestion(model: Any, word: str) -> str:
  """The word in quotes, and what was meant where it is misspelled: no word of the encoder's, but like a known one."""
  known = sorted(model.encoder.known_words)
  if model.captions:
    vocabulary = model.captions.vocabulary
    known = sorted({*vocabulary.words, *(one for one in known if not vocabulary.missing(one))})
  other = "" if any(map(model.encoder.is_piece, possible_bases(word.lower()))) else closest_word(word, known)
  return f"{word!r} (did you mean {other!r}?)" if other else repr(word)


def shortened(text: str) -> str:
  """The text in quotes, cut where it is long."""
  return repr(text if len(text) <= 120 else text[:119] + "…")
