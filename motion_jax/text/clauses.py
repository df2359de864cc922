"""Clauses of a sentence that happen one after the other, for attention that is steered to the clause that is due.

A plain reading by connectors ("then", "before", "followed by", commas and "and" before a verb), for a model without the
application's parser, which also knows ellipses, counts, durations and actions at the same time.
"""
import re

from motion_jax.text.morphology import is_participle, verb_of

_TOKEN = re.compile(r"[\w'-]+|[,.;]")
_THEN = (("and", "then"), ("then",), ("after", "that"), ("afterwards",), ("and", "finally"), ("finally",),
         ("followed", "by"), ("and", "after", "that"))
_AT_ONCE = {"while", "whilst", "simultaneously", "as", "during", "same"}


class Clause(str):
  """The part `number` of a sentence; its words and those of the subject are at `spans`, pairs of characters."""
  sentence: str
  spans: tuple[tuple[int, int], ...]

  def __new__(cls, sentence: str, number: int, spans: tuple[tuple[int, int], ...]) -> "Clause":
    clause = super().__new__(cls, f"{sentence} [{number + 1}]")
    clause.sentence, clause.spans = sentence, spans
    return clause


def clauses_of(sentence: str) -> list[str]:
  """The clauses of a sentence in the order in which they happen; [sentence] if there is one."""
  tokens = [(match[0].lower(), *match.span()) for match in _TOKEN.finditer(sentence)]
  words = [word for word, *_ in tokens]
  verbs = [_is_verb(word) for word in words]
  if True not in verbs:
    return [sentence]
  borders = _borders(words, verbs)
  if not borders:
    return [sentence]
  subject = (0, tokens[verbs.index(True)][1])
  parts = []
  for first, past in zip([0, *(past for _, past in borders)], [*(first for first, _ in borders), len(tokens)]):
    parts.append((tokens[first][1], tokens[past - 1][2]))
  if words[0] == "before" or any(words[first] == "after" for first, past in borders if past == first + 1):
    parts[:2] = parts[1::-1]  # "before sitting down, he walks", "he waves after walking"
  return [Clause(sentence, number, (subject, part)) for number, part in enumerate(parts)]


def _is_verb(word):
  return word.endswith("s") and verb_of(word) not in ("", word) or is_participle(word)


def _borders(words, verbs):
  """[(first, past)] of the connectors between clauses, of which all but the last have a verb."""
  at_once, borders, begin, at = bool(_AT_ONCE & set(words)), list[tuple[int, int]](), 0, 1
  while at < len(words):
    past = _connector(words, verbs, at, at_once)
    if past and True in verbs[begin:at] and past < len(words) - (words[-1] in ",.;"):
      borders.append((at, past))
      begin = at = past
    at += 1
  return borders


def _connector(words, verbs, at, at_once):
  """The token after a connector that begins at a token; 0 for none."""
  past = at
  while past < len(words) and words[past] in (",", ".", ";"):
    past += 1
  explicit = max((len(phrase) for phrase in _THEN if tuple(words[past:past + len(phrase)]) == phrase), default=0)
  if explicit:
    return past + explicit
  if past < len(words) and words[past] in ("before", "after") and any(verbs[past + 1:past + 4]):
    return past + 1
  if past > at and (words[at] != "," or words[0] in ("before", "after") and "," not in words[:at]):
    return past  # another sentence, or the main clause
  past += past < len(words) and words[past] == "and"
  return past if past > at and past < len(words) and verbs[past] and words[past].endswith("s") and not at_once else 0
