"""A text becomes clauses: cut at connectors and participles, then joined again where a part is no action of its own."""
import re
from typing import NamedTuple

from motion_jax.text.morphology import is_participle, verb_of
from motion_jax.text.tagger import tag_words
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.clause import (
  Clause,
  can_be_simultaneous,
  clause_of,
  is_person,
  keeps_limbs,
  unknown_verb,
)
from motion_jax_studio.language.counting import with_numbers
from motion_jax_studio.language.ellipsis import completed

# Connectors by the order in time that they give.
_CONNECTORS = {
    "then": "and then, but then, and after that, after that, after which, after a while, after a moment, a moment "
            "later, and afterwards, afterwards, followed by, and finally, finally, and lastly, lastly, and next, next, "
            "and later, later on, then, ;, ., !, ?",
    "before": "before",
    "after": "after, once, when",
    "until": "until, till, and then until",
    "while": "while also, while, whilst, and at the same time, at the same time as, and simultaneously, during, as",
    "and": "and also, and, but"}
_KIND_OF = {words: kind for kind, row in _CONNECTORS.items() for words in row.split(", ")} | {",": ","}
_LONGEST = max(len(words.split()) for words in _KIND_OF)
_STRENGTH = ("", ",", "and", "then", "while", "until", "after", "before")
_TOKEN = re.compile(r"\d+(?:\.\d+)?|\w+(?:['’-]\w+)*|\S", re.UNICODE)
_SUBORDINATE = ("before", "after", "while", "until")
_LONGEST_CLAUSE = 40  # words after which a participle begins no further clause


def _connector_at(words, at):
  """(number of tokens, kind) of the connector that begins at words[at]; (0, "") if there is none."""
  for length in range(min(_LONGEST, len(words) - at), 0, -1):
    name = " ".join(words[at:at + length])
    if name in _KIND_OF:
      after = words[at + length] if at + length < len(words) else ""
      before = words[at - 1] if at else ""
      return (0, "") if _is_another_word(name, before, after) else (length, _KIND_OF[name])
  return 0, ""


def _is_another_word(connector, before, after):
  """Whether the words of a connector mean something else between these neighbours, as in "rests for a while"."""
  return (connector == "as" and after in lexicon.NOT_A_CONNECTOR_AFTER_AS
          or connector == "next" and after == "to"
          or connector == "once" and (after in lexicon.AFTER_ONCE or not after[:1].isalnum())
          or connector == "while" and before in lexicon.BEFORE_WHILE)  # "rests for a while"


def _stronger(first, second):
  """The more specific of two adjacent connectors: "while" of "and while"."""
  return max(first, second, key=_STRENGTH.index)


def fragments_of(text):
  """The text cut at its connectors: [(name of the connector before it, the connector's tokens, tokens)].

  The name is "" for the first fragment.
  """
  tokens = _TOKEN.findall(lexicon.spelt(text).lower().replace("’", "'"))
  fragments, kind, start, at = [], "", 0, 0
  between = []  # tokens of the connectors since the last fragment
  while at < len(tokens):
    length, here = _connector_at(tokens, at)
    begins = "" if length else _begins_at_verb(tokens, start, at)
    if begins:
      fragments.append((kind, between, tokens[start:at]))
      kind, between, start = begins, [], at
    if length:
      if at > start:
        fragments.append((kind, between, tokens[start:at]))
        kind, between = "", []
      kind, between = _stronger(kind, here), [*between, *tokens[at:at + length]]
      start = at + length
    at += length or 1
  if start < len(tokens):
    fragments.append((kind, between, tokens[start:]))
  return _with_subjects(fragments)


def _with_subjects(fragments):
  """The fragments, with each lone subject moved to the fragment after it: "he" and "sits" of "he then sits"."""
  joined: list = []
  for kind, between, tokens in fragments:
    if len(joined) > 1 and _is_subject(joined[-1][2]):
      before, words, subject = joined.pop()
      kind, between, tokens = _stronger(before, kind), [*words, *between], [*subject, *tokens]
    joined.append((kind, between, tokens))
  return joined


def _is_subject(words):
  return words in ([pronoun] for pronoun in lexicon.SUBJECT_PRONOUNS) or (
      words[0] in lexicon.DETERMINERS and words[-1] in lexicon.PEOPLE - {"one"})


def _begins_at_verb(words, start, at):
  """The connector that is missing before words[at]: "while" in "walks forward waving both hands", "then" in "turns
  around walks back"; "" if no action begins there."""
  return ("while" if _begins_at_participle(words, start, at) else
          "then" if _begins_at_finite_verb(words, start, at) else "")


def _begins_at_finite_verb(words, start, at):
  """Whether a verb in the third person follows a whole clause."""
  verb = verb_of(words[at])
  if at - start < 2 or verb in ("", words[at]) or not words[at].endswith("s") or (
      words[at] in {"jacks", *lexicon.PATH_NOUNS} or words[at - 1] in lexicon.PEOPLE):
    return False
  clause, before = clause_of(words[start:at]), tag_words(words[start:at])[-1][1]
  if words[at] in lexicon.STAIRS and (before != "NOUN" or words[at - 1] in lexicon.NUMBERS or (
      words[at + 1:at + 2] not in ([direction] for direction in lexicon.DIRECTIONS))):
    return False  # "walks up the steps", but not "stands with the arms at the sides, steps forward"
  if clause is None or clause.verb in lexicon.WITH_ACTIONS_AS_OBJECTS:
    return False
  if words[at - 1] == clause.form:  # "a person standing scratches his head"
    return is_participle(clause.form)
  return before in ("ADV", "NOUN") or words[at - 1] in lexicon.DIRECTIONS | {"out"}


def _begins_at_participle(words, start, at):
  """Whether an action of arms or head begins at this word of a fragment."""
  if not 2 <= at - start <= _LONGEST_CLAUSE or not is_participle(words[at]) or keeps_limbs(words, at) or (
      (lexicon.BEFORE_A_PARTICIPLE | lexicon.POSSESSIVES) & {words[at - 1], verb_of(words[at - 1])}):
    return False
  last_tag = tag_words(words[start:at])[-1][1]
  clause, waving = clause_of(words[start:at]), clause_of(words[at:at + 4])
  return last_tag not in ("ADP", "DET", "ADJ", "NUM", "AUX") and clause is not None and waving is not None and (
      waving.part in ("arms", "head")) and can_be_simultaneous([clause], waving)


class Part(NamedTuple):
  """The tokens of one clause, and the connector that joins it to the clause before it."""
  kind: str      # the connector; "lead before" for a subordinate clause in front, "main before" for its main clause
  between: list  # the connector's tokens
  tokens: list
  clause: Clause | None


def parts_of(fragments):
  """The clauses of fragments, each a `Part`; a fragment that is no action of its own is joined to the one before it."""
  result: list[Part] = []
  lead = ""          # the connector of a subordinate clause in front, until its main clause comes
  subject: list[str] = []  # of a clause in front that is no action
  for place, (kind, between, tokens) in enumerate(fragments):
    clause = clause_of(tokens)
    if clause is None and not result and fragments[place + 1:] and fragments[place + 1][0] == "then" and (
        state := _state_of(tokens)):
      subject = state
      continue  # "is ready, then walks"
    if clause is None and (kind == "then" or _begins_with_object(tokens[1:])) or (
        kind == "then" and clause.subject and not is_person(clause.subject)):
      clause = unknown_verb(tokens) or clause
    if clause and subject and not result:
      kind, clause, subject = "", clause._replace(subject=clause.subject or subject), []
    if not result and clause and place + 1 < len(fragments) and _is_no_action(clause, fragments[place + 1]):
      subject = clause.subject
      continue
    if not result:
      lead = kind if kind in _SUBORDINATE else ""
      result.append(Part(lead and f"lead {lead}" or "", [], tokens, clause))
      continue
    previous = result[-1]
    if previous.clause is None and kind == "," and clause and is_participle(clause.form) and (
        is_person(previous.tokens)) and not lead:  # "a person, walking forward, waves"
      result[-1] = Part("lead while", [], tokens, clause._replace(subject=previous.tokens))
      lead = "while"
      continue
    more = None if previous.clause is None else completed(
        [part.clause for part in result if part.clause], kind, tokens, clause)
    clause = clause if more is None else more
    part = Part(kind, between, tokens, clause)
    if more is None and (clause is None or previous.clause is None or not _stands_alone(part, previous)):
      result[-1] = _joined(previous, part)
      continue
    if lead and (kind != "and" or clause.subject):  # "before sitting down and waving, he bows"
      part, lead = part._replace(kind=f"main {lead}"), ""
    result.append(part)
  return result


def clauses_of(parts, keep_together=None):
  """[(connector, clause)] of parts, with their numbers read.

  keep_together: whether words are one action although they could be two, as "walks and turns left" can.
  """
  result = []
  for part in parts:
    if keep_together and result and part.kind in ("and", "while") and (
        keep_together(" ".join([*result[-1].tokens, *part.between, *part.tokens]))):
      result[-1] = _joined(result[-1], part)
    else:
      result.append(part)
  return [(part.kind, part.clause and with_numbers(part.clause)) for part in result]


def _state_of(tokens):
  """The subject of a fragment that describes a state, not an action: "a man" of "a man is ready"; else []."""
  at = next((at for at, word in enumerate(tokens) if word in lexicon.BEING), 0)
  return tokens[:at] if at and is_person(tokens[:at]) else []


def _is_no_action(clause, then):
  """Whether a clause in front only says where or how a person is: "starts in a spot", "a man standing" (waves), "from a
  standing position"."""
  if clause.verb in lexicon.STARTING:
    return clause.words[:1] and clause.words[0] in lexicon.AT_A_PLACE
  kind, between, _ = then
  if clause.verb in lexicon.IDLE and clause.before[:1] == ["from"]:
    return True
  return clause.verb in lexicon.IDLE and is_participle(clause.form) and kind == "then" and not between


def _joined(previous, part):
  """The previous part with the tokens of the next one added."""
  added = [*part.between, *part.tokens]
  tokens, clause = [*previous.tokens, *added], previous.clause
  if clause is not None:
    again = clause_of(tokens)
    clause = again if clause.reworded or again is not None and again.reworded else (
        clause._replace(words=[*clause.words, *added]))  # "takes a bow and a step back"
  elif part.clause is not None:
    clause = clause_of(tokens)
  return previous._replace(tokens=tokens, clause=clause)


def _stands_alone(part, previous):
  """Whether a fragment after a connector is an action of its own, not a continuation of the previous fragment."""
  kind, clause, before = part.kind, part.clause, previous.clause
  if clause.subject and not is_person(clause.subject):
    return False
  if clause.verb == "land":
    return False  # "jumps up, then lands"
  if kind == "and" and not before.words and before.verb in lexicon.OF_AN_OBJECT:
    return False  # "lifts and bends his right leg"
  if kind == "," and is_participle(clause.form) and not can_be_simultaneous([before], clause):
    return clause.verb in lexicon.HALTING_VERBS  # "walks, stopping", but not "walks, turning left"
  if kind in ("and", ","):
    if _ends_in_nouns(before) or clause.verb in lexicon.LIGHT_VERBS and (
        lexicon.PATH_NOUNS & set(clause.words)):
      return False  # "walks and makes a u-turn"
    if clause.form.endswith("ed") and not clause.subject and not before.form.endswith("ed") and not (
        _begins_with_object(clause.words)):
      return False  # "walks forward, directed to the right", but not "sits down and crossed his legs"
    begins = is_participle(part.tokens[0])
    if not begins and is_participle(clause.form) and clause.verb == before.verb and not clause.words:
      return False  # "walks forward and keeps walking"
    if begins and kind == "and" and before.form != clause.form and not (
        is_participle(before.form) or previous.kind in ("while", ",")):
      return False  # "walks with jumping and singing"
    return bool(verb_of(clause.form) or before.words and _begins_with_object(clause.words))
  if kind == "while" and not can_be_simultaneous([before], clause):
    return False  # "turns left while walking"
  if kind in _SUBORDINATE:
    return bool(clause.subject or is_participle(clause.form) or not clause.before)
  return True


def _begins_with_object(words):
  return words[:1] in ([word] for word in {"both", *lexicon.DETERMINERS, *lexicon.POSSESSIVES, *lexicon.LIMBS})


def _ends_in_nouns(clause):
  """Whether a clause ends in a thing that looks like a verb: "throws punches" (and kicks)."""
  last = clause.words[-1] if clause.words else ""
  return last.endswith("s") and verb_of(last) not in ("", "cross") and last not in ("arms", "hands", "steps")
