"""Verbs that mean much the same, from WordNet 3.0: to amble is to walk slowly.

`lexicon.tsv` is derived by `tools/derive_lexicon.py` from the database of Princeton University, under the licence in
LICENSE beside it.
"""
import functools
import pathlib
from typing import NamedTuple

TABLE = pathlib.Path(__file__).with_name("lexicon.tsv")

_SURE = 0.7  # confidence from which a word in the form of a verb is read as one
LOST = "!"  # a word of manner that stands for a look which no word of the target expresses


class Target(NamedTuple):
  """A verb of movement that another verb may stand for, and the words of its manner: "slowly", "backward"."""
  verb: str
  confidence: float
  manner: tuple[str, ...] = ()


@functools.cache
def _rows():
  """The lines of the table by kind: {"v": {verb: fields}, "v~": ..., "n": ..., "m": ...}."""
  rows = {"v": {}, "v~": {}, "n": {}, "m": {}}
  for line in TABLE.read_text("utf-8").splitlines():
    kind, word, *fields = line.split("\t")
    rows[kind][word] = fields
  return rows


@functools.lru_cache(maxsize=1 << 12)
def targets(verb: str) -> tuple[Target, ...]:
  """What a verb in base form, with or without its particle ("hunker down"), may stand for; the surest first."""
  fields = _rows()["v"].get(verb) or _rows()["v~"].get(verb, ())
  rows = (field.split(":") for field in fields)
  return tuple(Target(row[0], float(row[1]), tuple(row[2].split()) if len(row) > 2 else ()) for row in rows)


@functools.cache
def verbs() -> frozenset[str]:
  """The verbs of the table that surely stand for another and are not more often nouns, as "hand" and "shoulder" are."""
  return frozenset(verb for verb in _rows()["v"] if targets(verb)[0].confidence >= _SURE)


def verb_of_noun(noun: str) -> str:
  """The verb of the action that a noun names, "" where it names none: curtsy -> curtsy, applause -> applaud."""
  return next(iter(_rows()["n"].get(noun, ())), "")


def pace_of(word: str) -> str:
  """"quickly" or "slowly" for an adjective or adverb of pace (brisk, leisurely), "" for another word."""
  return next(iter(_rows()["m"].get(word, ())), "")
