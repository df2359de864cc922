"""Sentences cut into clauses (`clause`), one for each thing that is done.

`sentences` puts them in order. What is no action of its own stays with the words before it.
"""
import re

from motion_jax.text.tagger import tag_words
from motion_studio.language import actions
from motion_studio.language.clause import (
  PEOPLE,
  clause_of,
  counted,
  fit,
  is_ing,
  is_person,
  lower,
  part_of,
  unknown_verb,
)
from motion_studio.language.ellipsis import more_of_it
from motion_studio.language.light_verbs import LIGHT

_TOKEN = re.compile(r"\d+(?:\.\d+)?|\w+(?:['’-]\w+)*|\S", re.UNICODE)
_NOT = re.compile(r"(?i)\b(do|does|did)n['’]t\b")
_DETERMINERS = {"the", "a", "an", "this", "that"}
_ACTORS = {"he", "she", "they", "i"}
_LONGEST_SUBJECT = 5  # "the tired old man"
_LONG = 40  # words of a clause behind which no further one begins unmarked
_IN_A_ROW = ("and then", "but then", "and after that", "after that", "after which", "after a while", "after a moment",
             "a moment later", "and afterwards", "afterwards", "followed by", "and finally", "finally", "and lastly",
             "lastly", "and next", "next", "and later", "later on", "then", ";", ".", "!", "?")
_AT_ONCE = ("while also", "while", "whilst", "and at the same time", "at the same time as", "and simultaneously",
            "during", "as")
_CONNECTORS = {words: kind for kind, group in {
    "then": _IN_A_ROW, "while": _AT_ONCE, "before": ("before",), "after": ("after", "once", "when"),
    "until": ("until", "till", "and then until"), "and": ("and also", "and", "but"), ",": (",",)}.items()
               for words in group}
_ASPECTS = set("be start begin continue keep proceed resume go stop quit finish do try practice perform pause like by "
               "and".split())
_BEHIND_ONCE = set("with on to in at from by and again more".split())  # "kicks left, then once with the right"
_PATHS = {"u-turn", "circle", "circles", "loop", "zigzag", "arc", "detour"}  # shapes of a way that is walked
_LONGEST = max(len(words.split()) for words in _CONNECTORS)


def fragments_of(text):
  """The text cut at its connectors: [(how it is joined to what is before, connector's tokens, tokens)]; joins are keys
  of `_CONNECTORS`, "" at the start."""
  tokens = _TOKEN.findall(_NOT.sub(r"\1 not", text))
  lower = [token.lower().replace("’", "'") for token in tokens]
  found, kind, start, at = [], "", 0, 0
  said = []  # connectors as they stand between the fragments
  while at < len(tokens):
    length, here = _connector(lower, at)
    if not length and _is_participle(lower, start, at):
      found.append((kind, said, tokens[start:at]))
      kind, said, start = "while", [], at
    if length:
      if at > start:
        found.append((kind, said, tokens[start:at]))
        kind, said = "", []
      kind, said = _stronger(kind, here), [*said, *tokens[at:at + length]]
      start = at + length
    at += length or 1
  if start < len(tokens):
    found.append((kind, said, tokens[start:]))
  return found


def _is_participle(words, start, at):
  """Whether another part's action begins at this word of a fragment, as in "walks forward waving both hands"."""
  if not 2 <= at - start <= _LONG or not is_ing(words[at]) or (
      _ASPECTS & {words[at - 1], actions.verb_of(words[at - 1])}):
    return False
  tags = [pos for _, pos in tag_words(words[start:at])]
  clause, own = clause_of(words[start:at]), clause_of(words[at:at + 4])
  return tags[-1] not in ("ADP", "DET", "ADJ", "NUM", "AUX") and clause is not None and own is not None and (
      part_of(own) in ("arms", "head")) and fit([clause], own)


def _connector(lower, at):
  """(tokens, kind) of the connector that begins here, or (0, "")."""
  for length in range(min(_LONGEST, len(lower) - at), 0, -1):
    words = " ".join(lower[at:at + length])
    if words in _CONNECTORS:
      after = lower[at + length] if at + length < len(lower) else ""
      if words == "as" and after in ("if", "though", "well", "a", "an"):
        return 0, ""
      if words == "next" and after == "to" or words == "then" and after in ("more", "again"):
        return 0, ""
      if words == "once" and (after in _BEHIND_ONCE or not re.match(r"\w", after)):
        return 0, ""
      if words == "while" and at and lower[at - 1] in ("a", "little", "short", "long", "good"):
        return 0, ""  # "rests for a while"
      return length, _CONNECTORS[words]
  return 0, ""


def _stronger(one, other):
  """Of two connectors in a row (", and", "and while") the one that says more."""
  order = ("", ",", "and", "then", "while", "until", "after", "before")
  return max(one, other, key=order.index)


def joined(fragments, known):
  """Fragments [(kind, connector's tokens, tokens)] to [(kind, clause)]: what is no action of its own stays with the
  words before it, connector and all. known: whether such words stay together, as one action that a model has learned.
  """
  fragments = [(kind, said, list(tokens)) for kind, said, tokens in _with_main_clause(fragments)]
  result: list = []  # [kind, tokens, clause or None]
  lead = ""          # a subordinate clause in front waits for its main clause
  for kind, said, tokens in fragments:
    clause = clause_of(tokens) or (unknown_verb(tokens) if kind == "then" else None)
    if not result:
      lead = kind if kind in ("before", "after", "while", "until") else ""
      if lead and clause and clause.subject and not is_person(clause.subject) and len(fragments) > 1:
        lead = ""
        continue  # "when the music starts, the man dances"
      result.append([lead and f"lead {lead}" or "", tokens, clause])
      continue
    previous = result[-1]
    if previous[2] is None and kind == "," and clause and is_ing(clause.form) and is_person(previous[1]) and not lead:
      result[-1] = ["lead while", tokens, clause._replace(subject=previous[1])]  # "a person, walking forward, waves"
      lead = "while"
      continue
    more = None if previous[2] is None else more_of_it([one for _, _, one in result if one], kind, tokens, clause)
    clause = clause if more is None else more
    apart = more is not None or clause is not None and previous[2] is not None and (
        _stands_alone(kind, clause, tokens, previous))
    if apart and kind in ("and", "while") and known(" ".join([*previous[1], *said, *tokens])):
      apart = False
    if not apart:
      previous[1] += [*said, *tokens]
      if previous[2] is not None:
        again = clause_of(previous[1])
        if previous[2].reworded or again is not None and again.reworded:
          previous[2] = again  # "takes a bow and a step back", "goes ahead and to the left without turning"
        else:
          previous[2].words.extend([*said, *tokens])
      elif clause is not None:
        previous[2] = clause_of(previous[1])
      continue
    if lead and kind in (",", "then", "and") and (kind != "and" or clause.subject):
      kind, lead = f"main {lead}", ""
    result.append([kind, tokens, clause])
  return [(kind, clause and counted(clause)) for kind, _, clause in result]


def _with_main_clause(fragments):
  """The fragments, the first parted where its main clause begins without a comma: "after she sits she gets up"."""
  if not fragments or fragments[0][0] not in ("before", "after", "while", "until"):
    return fragments
  (kind, said, tokens), *rest = fragments
  words = lower(tokens)
  for at in range(1, len(words)):
    clause = clause_of(tokens[at:]) if words[at] in _ACTORS | _DETERMINERS else None
    subject = lower(clause.subject) if clause is not None else []
    begun = subject and subject[-1] in PEOPLE and not is_ing(clause.form) and not _DETERMINERS & set(subject[1:])
    if begun and len(subject) <= _LONGEST_SUBJECT and clause_of(tokens[:at]) is not None:
      return [(kind, said, tokens[:at]), (",", [","], tokens[at:]), *rest]
  return fragments


def _stands_alone(kind, clause, tokens, previous):
  """Whether a fragment behind a connector is an action, and not more words of the one before."""
  if clause.subject and not is_person(clause.subject):
    return False
  if kind == "and" and not clause.verb:
    return False
  if kind == "," and is_ing(clause.form) and not fit([previous[2]], clause):
    return False  # "walks, turning left"
  if kind in ("and", ","):
    if _noun_list(previous) or clause.verb in LIGHT and _PATHS & {word.lower() for word in clause.words}:
      return False  # "walks and makes a u-turn"
    begun = is_ing(lower(tokens)[0])
    if not begun and is_ing(clause.form) and clause.verb == previous[2].verb and not clause.words:
      return False  # "walks forward and keeps walking"
    if begun and kind == "and" and previous[2].form != clause.form and not (
        is_ing(previous[2].form) or "is" in previous[2].subject or previous[0] in ("while", ",")):
      return False  # "walks with jumping and singing"
    return bool(actions.verb_of(clause.form.lower()))
  if kind == "while" and not previous[0].startswith("lead") and not fit([previous[2]], clause):
    return False  # "turns left while walking"
  if kind in ("while", "before", "after", "until"):
    return bool(clause.subject or is_ing(clause.form) or kind == "until" or not clause.before)
  return True


def _noun_list(previous):
  """Whether what was before ends in a thing that looks like a verb: "throws punches" (and kicks)."""
  clause = previous[2]
  last = clause.words[-1].lower() if clause.words else ""
  return last.endswith("s") and bool(actions.verb_of(last)) and actions.verb_of(last) != "cross" and (
      last not in ("arms", "hands", "steps"))
