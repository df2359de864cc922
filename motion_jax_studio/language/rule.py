"""One row of the grammar: a name, what the rule does, and example sentences with their parse.

The parse is written as `Plan.summary` writes it: "|" separates segments, "+" joins simultaneous actions, [2] is a
duration in seconds. The same rows drive the parser where they have a `read`, are run by `tests/studio/language`, and
make the tables of docs/sentences.md (`grammar.tables`).
"""
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class Rule(NamedTuple):
  """A rule of the grammar. read: the function that applies it, None where the parser does so itself."""
  name: str
  meaning: str
  examples: Mapping[str, str]  # sentence -> parse
  read: Callable[..., Any] | None = None


def first_match(rules, *args):
  """What the first rule that applies makes of the arguments, None where none applies."""
  return next((found for rule in rules if rule.read and (found := rule.read(*args)) is not None), None)
