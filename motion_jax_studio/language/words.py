"""Tokens and phrase tables: how the slots of an action are read from its words.

A phrase table is a sequence of (value, phrases); the first row with a phrase in the text gives the value:

  lookup((("down", "at sides"), ("out", "out, extend*")), normalize("holds the arms out at his sides"))  ->  "down"

Phrases are whole words without articles and possessives, separated by commas; a final "*" stands for any ending.
"""
import functools
import re
from collections.abc import Iterable
from typing import Any

from motion_jax_studio.language import lexicon

_ONE, _PEOPLE = "(?:man|woman|person|boy|girl)", (
    "(?:people|persons|men|women|boys|girls|guys|kids|children|friends|dancers|fighters|boxers|figures|players)")
_SEVERAL_PEOPLE = re.compile(
    rf"\b(?:two|three|four|five|six|ten|several|some|many|both|a (?:couple|group|pair|crowd) of) (?:\w+ )?{_PEOPLE}\b|"
    rf"^(?:the |some )?{_PEOPLE}\b|\beach other\b|\bone another\b|\banother (?:{_ONE}|guy|figure)\b|"
    rf"\b(?:a|the|one) (?:\w+ )?{_ONE} and (?:a|the|another|one) (?:\w+ )?{_ONE}\b|"
    r"\b(?:his|her|their|a|the) (?:partner|opponent|friend)\b", re.IGNORECASE)
_DROPPED = lexicon.POSSESSIVES | {"the", "a", "an"}


@functools.lru_cache(maxsize=1 << 14)
def tokens(text: str) -> tuple[str, ...]:
  """Lower-case tokens of a text, commas included: ("walks", "forward", ",", "then", "bows")."""
  words = text.lower().replace("’", "'").replace("-and-", " and ").replace(",", " , ").split()
  return tuple(word for word in (word.strip(".;:!?()") for word in words) if word)


def normalize(words: Any) -> str:
  """Normalize a text, or its tokens, for phrase lookup: no articles and possessives, a space at both ends."""
  words = tokens(words) if isinstance(words, str) else words
  return f" {' '.join(word for word in words if word not in _DROPPED)} "


def has_phrase(text: str, phrases: str) -> bool:
  """Whether a text normalized by `said` contains one of the phrases."""
  return any((phrase[:-1] if phrase[-1] == "*" else phrase + " ") in text for phrase in _split(phrases))


@functools.lru_cache(maxsize=1 << 10)
def _split(phrases):
  return tuple(f" {phrase}" for phrase in phrases.split(", "))


def lookup(table: Iterable[tuple[Any, str]], text: str, default: Any = None) -> Any:
  """The value of the first row of a phrase table that occurs in a normalized text, else the default."""
  return next((value for value, phrases in table if has_phrase(text, phrases)), default)


def until(words: tuple[str, ...], ends: Any) -> tuple[str, ...]:
  """The words up to the first one, after the verb (words[0]), that is in `ends`."""
  return words[:next((at for at, word in enumerate(words) if at and word in ends), len(words))]


def letters(text: str) -> list[str]:
  """Lower-case words of a text, without digits and punctuation."""
  return re.findall("[a-z]+", text.lower())


def several_people(text: str) -> str:
  """The words of a text that name several people: "two men" of "two men fight"; "" for a text about one person."""
  people = _SEVERAL_PEOPLE.search(text)
  return people[0] if people else ""
