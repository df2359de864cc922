"""Sentences of several actions, understood by rule: what comes after what, what goes on at the same time, how long.

  understand("After sitting down, an old man walks forward while waving, then stops.")
  -> sits down | walks forward + waves | stands still, all of them of "an old man"

In a row: then, after that, next, finally, before, after, until, a full stop, a semicolon, commas between verbs, "and"
between actions of one part of the body or of which one is done once ("sits down and stands up"). At once: while, as,
during, at the same time, a participle ("walks, waving the left hand"), "with the right hand raised", and "and" where
the legs merely go on ("walks and waves"). Whatever is not surely understood stays in its clause as it was said: "up and
down", "back and forth" and "with anger and pride" are never parted. No language model and no learning: a list of verbs,
a tagger (`data.tagger`) and these rules.
"""
import re
from collections.abc import Callable
from typing import NamedTuple

from motion_jax.data.tagger import tag_words
from motion_jax.text import actions

REST = "stands still"
_NUMBERS = {word: number for number, word in enumerate(
    "zero one two three four five six seven eight nine ten eleven twelve".split())} | {
        "a": 1, "an": 1, "half": 0.5, "couple": 2, "few": 3, "several": 3, "many": 4}
_TOKEN = re.compile(r"\d+(?:\.\d+)?|\w+(?:['’-]\w+)*|\S", re.UNICODE)
_PEOPLE = set("person man woman boy girl child kid guy lady figure human dancer boxer player character people men "
              "women children somebody someone anybody everyone one he she they i you we it who him her them athlete "
              "actor soldier robot zombie giant thug teenager adult".split())
_PLURAL = set("people men women children they we i you".split())
_OTHER = {"another", "other", "second", "else", "each"}
_PRONOUNS = {"he", "she", "they", "it", "who", "i", "you", "we"}
_POSSESSIVES = {"his", "her", "their", "its", "my", "your", "our"}
_OF_EACH_ARM = {"wave", "raise", "lift", "hold", "stretch", "extend", "lower", "swing", "put"}
_LONG = 40  # words of a clause behind which no further one begins unmarked
_LIGHT = {"also", "again", "just", "first", "soon"}
_DIRECTIONS = set("left right forward forwards backward backwards back sideways up down around ahead away clockwise "
                  "counterclockwise again".split())
_IN_A_ROW = ("and then", "but then", "and after that", "after that", "after which", "after a while", "after a moment",
             "a moment later", "and afterwards", "afterwards", "followed by", "and finally", "finally", "and lastly",
             "lastly", "and next", "next", "and later", "later on", "then", ";", ".", "!", "?")
_AT_ONCE = ("while also", "while", "whilst", "and at the same time", "at the same time as", "and simultaneously",
            "during", "as")
_TOGETHER = ("at the same time", "simultaneously", "at once", "meanwhile")
_CONNECTORS = {words: kind for kind, group in {
    "then": _IN_A_ROW, "while": _AT_ONCE, "before": ("before",), "after": ("after", "once", "when"),
    "until": ("until", "till", "and then until"), "and": ("and also", "and", "but"), ",": (",",)}.items()
               for words in group}
_ASPECTS = set("be start begin continue keep proceed resume go stop quit finish do try practice perform pause like by "
               "and".split())
_LONGEST = max(len(words.split()) for words in _CONNECTORS)
_HANDS_UP = re.compile(r"\bwith (?:(?:his|her|their|its|the|a|an|one|both) )*((?:left |right )?)(hands?|arms?) "
                       r"(?:(?:held|stretched|lifted) )?(?:raised|lifted|up|in the air|high|overhead|"
                       r"(?:above|over) (?:(?:his|her|their|the) )?head)(?: (?:up|high|in the air))?\b")


class Action(NamedTuple):
  """One thing that a body does: what, as a sentence and without its subject, and with which part."""
  prompt: str      # "a person waves the right hand"
  words: str       # "waves the right hand"
  part: str = ""   # of `actions.PARTS`
  sides: tuple[str, ...] = ()  # the arms that it names
  times: int = 1   # how often, where the sentence counts
  verb: str = ""   # its base form
  held: bool = False  # a pose that is kept, as of "with the right hand raised"


class Segment(NamedTuple):
  """What is done at one time: an action of the whole body, and others by parts of it."""
  action: Action
  also: tuple[Action, ...] = ()
  seconds: float | None = None  # how long, where the sentence says

  @property
  def words(self) -> str:
    return " + ".join(one.words + (f" {one.times} times" if one.times > 1 else "") for one in (self.action, *self.also))

  @property
  def prompt(self) -> str:
    return " and ".join([self.action.prompt, *(one.words for one in self.also)])

  @property
  def rests(self) -> bool:
    return self.action.words == REST


class Sentence(NamedTuple):
  """What was understood: segments in the order in which they are done."""
  text: str
  segments: tuple[Segment, ...]

  @property
  def prompts(self) -> list[str]:
    """All that is said to a model, each action by itself; a body that rests is told nothing."""
    rests = len(self.segments) > 1
    return list(dict.fromkeys(one.prompt for part in self.segments if not (rests and part.rests)
                              for one in (part.action, *part.also)))

  @property
  def is_plain(self) -> bool:
    """Whether it is one action and no more, so that it is said to a model as it was written."""
    first = self.segments[0]
    return len(self.segments) == 1 and not first.also and first.action.times == 1 and first.seconds is None


class _Clause(NamedTuple):
  """Words of one action: who, what, how often; and where its verb is among the words."""
  subject: list[str]
  before: list[str]   # slowly
  verb: str           # base form
  form: str           # as it was written
  words: list[str]    # behind the verb
  times: int = 1
  seconds: float | None = None
  at_once: bool = False  # with the action before it, as the sentence says in so many words


def understand(text: str, known: Callable[[str], bool] = lambda text: False) -> Sentence:
  """The actions of a sentence, or of several: one segment with the text as it is where nothing is to be parted.

  known: whether a model has learned such words as one action; these stay together ("walks and turns left").
  """
  plain = Sentence(text, (Segment(Action(text, text)),))
  if known(text):
    return plain
  pieces = _pieces(text, known)
  clauses = [clause for _, clause in pieces]
  if not clauses or None in clauses:
    return plain
  subject = _subject(clauses)
  if subject is None:
    return plain
  groups = _arranged(_begun(pieces))
  if groups is None:
    return plain
  segments = tuple(_segment(group, subject) for group in groups)
  found = Sentence(text, _without_repeated_rests(segments))
  return plain if found.is_plain else found


def is_ing(word: str) -> bool:
  return word.endswith("ing") and bool(actions.verb_of(word)) and actions.verb_of(word) != word


# --- from words to clauses -----------------------------------------------------------------------------------------


def _pieces(text, known):
  """[(how it is joined to what is before, clause)]; joins are keys of `_CONNECTORS`, "" at the start."""
  tokens = [token for token in _TOKEN.findall(text)]
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
  return _merged(found, known)


def _is_participle(words, start, at):
  """Whether another part's action begins at this word of a fragment, as in "walks forward waving both hands"."""
  if not 2 <= at - start <= _LONG or not is_ing(words[at]) or (
      _ASPECTS & {words[at - 1], actions.verb_of(words[at - 1])}):
    return False
  tags = [pos for _, pos in tag_words(words[start:at])]
  clause, own = _clause(words[start:at]), _clause(words[at:at + 4])
  return tags[-1] not in ("ADP", "DET", "ADJ", "NUM", "AUX") and clause is not None and own is not None and (
      _part(own) in ("arms", "head")) and _fit([clause], own)


def _connector(lower, at):
  """(tokens, kind) of the connector that begins here, or (0, "")."""
  for length in range(min(_LONGEST, len(lower) - at), 0, -1):
    words = " ".join(lower[at:at + length])
    if words in _CONNECTORS:
      after = lower[at + length] if at + length < len(lower) else ""
      if words == "as" and after in ("if", "though", "well", "a", "an"):
        return 0, ""
      if words == "next" and after == "to" or words in ("once", "then") and after in ("more", "again"):
        return 0, ""
      return length, _CONNECTORS[words]
  return 0, ""


def _stronger(one, other):
  """Of two connectors in a row (", and", "and while") the one that says more."""
  order = ("", ",", "and", "then", "while", "until", "after", "before")
  return max(one, other, key=order.index)


def _merged(fragments, known):
  """Fragments [(kind, connector's tokens, tokens)] to [(kind, clause)]: what is no action of its own stays with the
  words before it, connector and all."""
  result: list = []  # [kind, tokens, clause or None]
  lead = ""          # a subordinate clause in front waits for its main clause
  for kind, said, tokens in fragments:
    clause = _clause(tokens) or (_unknown_verb(tokens) if kind == "then" else None)
    if not result:
      lead = kind if kind in ("before", "after", "while", "until") else ""
      result.append([lead and f"lead {lead}" or "", tokens, clause])
      continue
    previous = result[-1]
    if previous[2] is None and kind == "," and clause and is_ing(clause.form) and _is_person(previous[1]) and not lead:
      result[-1] = ["lead while", tokens, clause._replace(subject=previous[1])]  # "a person, walking forward, waves"
      lead = "while"
      continue
    apart = clause is not None and previous[2] is not None and _stands_alone(kind, clause, tokens, previous)
    if apart and kind in ("and", "while") and known(" ".join([*previous[1], *said, *tokens])):
      apart = False
    if previous[2] is not None and clause is None and kind == "then":
      clause = _elliptic(previous[2], tokens)
      apart = clause is not None
    if not apart:
      previous[1] += [*said, *tokens]
      if previous[2] is not None:
        previous[2].words.extend([*said, *tokens])
      elif clause is not None:
        previous[2] = _clause(previous[1])
      continue
    if lead and kind in (",", "then", "and") and (kind != "and" or clause.subject):
      kind, lead = f"main {lead}", ""
    result.append([kind, tokens, clause])
  return [(kind, clause and _counted(clause)) for kind, _, clause in result]


def _stands_alone(kind, clause, tokens, previous):
  """Whether a fragment behind a connector is an action, and not more words of the one before."""
  if clause.subject and not _is_person(clause.subject):
    return False
  if kind == "and" and not clause.verb:
    return False
  if kind == "," and is_ing(clause.form) and not _fit([previous[2]], clause):
    return False  # "walks, turning left"
  if kind in ("and", ","):
    if _noun_list(previous):
      return False
    if is_ing(clause.form) and kind == "and" and previous[2].form != clause.form and not (
        is_ing(previous[2].form) or "is" in previous[2].subject or previous[0] in ("while", ",")):
      return False  # "walks with jumping and singing"
    return bool(actions.verb_of(clause.form.lower()))
  if kind == "while" and not previous[0].startswith("lead") and not _fit([previous[2]], clause):
    return False  # "turns left while walking"
  if kind in ("while", "before", "after", "until"):
    return bool(clause.subject or is_ing(clause.form) or kind == "until" or not clause.before)
  return True


def _noun_list(previous):
  """Whether what was before ends in a thing that looks like a verb: "throws punches" (and kicks)."""
  clause = previous[2]
  last = clause.words[-1].lower() if clause.words else ""
  return last.endswith("s") and bool(actions.verb_of(last)) and actions.verb_of(last) != "cross" and (
      last not in ("arms", "hands"))


def _clause(tokens):
  """The clause of some words, or None where there is no verb among them that says what is done."""
  words = [token.lower().replace("’", "'") for token in tokens]
  lemmas, tags = zip(*tag_words(words)) if words else ((), ())
  start = _first_verb(words, tags)
  if start is None:
    return None
  head, verb = start, actions.verb_of(words[start]) or lemmas[start]
  # "is walking", "starts to walk", "begins waving": the other verb says what is done.
  while True:
    step = head + 1
    while step < len(words) and (tags[step] == "ADV" and words[step].endswith("ly") or words[step] in ("to", "not")):
      step += 1
    aspect = verb in ("be", "start", "begin", "continue", "keep", "proceed", "resume", "will", "can") or (
        verb == "go" and step < len(words) and is_ing(words[step]))
    if not aspect or step >= len(words) or not actions.verb_of(words[step]):
      break
    head, verb = step, actions.verb_of(words[step])
  if tags[head] == "AUX" and verb != "do":  # "is happy", "can"
    return None
  subject, before = list(tokens[:start]), []
  while subject and subject[0].lower() in ("first", "firstly", "having", ","):
    del subject[0]
  while subject and (subject[-1].lower().endswith("ly") or subject[-1].lower() in _LIGHT):
    before.insert(0, subject.pop())
  if subject and not any(tag in ("NOUN", "PRON") for tag in tags[:start]):
    before, subject = subject + before, []
  before = [word for word in before if word.lower() != "first"]
  before += [token for token in tokens[start + 1:head] if token.lower().endswith("ly")]
  return _Clause(subject, before, verb, tokens[head].lower(), tokens[head + 1:])


def _unknown_verb(tokens):
  """The clause of "then warms them", whose verb is in no list."""
  word = tokens[0].lower()
  if not re.fullmatch(r"[a-z]{3,}s", word) or word.endswith(("ss", "us", "is")) or word in _DIRECTIONS or (
      tag_words([word])[0][1] != "NOUN"):
    return None
  return _Clause([], [], word[:-1], word, tokens[1:])


def _first_verb(words, tags):
  for at, (word, tag) in enumerate(zip(words, tags)):
    before = tags[at - 1] if at else ""
    if at and words[at - 1] in _POSSESSIVES or "jumping jack" in " ".join(words[max(at - 1, 0):at + 2]):
      continue  # "regains his balance"
    if tag in ("VERB", "AUX") and word not in ("being", "been", "having"):
      return at
    if tag in ("NOUN", "ADJ") and actions.verb_of(word) and before not in ("DET", "ADJ", "NUM", "ADP") and (
        before != "PRON" or words[at - 1] in _PRONOUNS):
      return at
  return None


def _elliptic(previous, tokens):
  """The clause of "then right" behind "turns left", of "then the right hand" behind "raises the left hand"."""
  words = [token.lower() for token in tokens]
  if words and all(word.endswith("ly") for word in words):
    return previous._replace(words=[word for word in previous.words if not word.endswith("ly")] + list(tokens),
                             before=[], subject=[])
  if words and all(word in _DIRECTIONS | {"to", "the"} for word in words) and (
      words != ["again"] and any(word in _DIRECTIONS for word in map(str.lower, previous.words))):
    return previous._replace(words=list(tokens), before=[], subject=[])
  if len(words) == 2 and words[0] in ("a", "an", "another") and actions.verb_of(words[1]):  # "followed by a jump"
    return _Clause([], [], actions.verb_of(words[1]), actions.verb_of(words[1]), [])
  limbs = {"hand", "arm", "leg", "foot", "knee", "elbow", "hands", "arms"}
  if words and words[-1] in limbs and all(word in {"the", "his", "her", "their", "with", "on", "left", "right", "both",
                                                   "other", "one"} | limbs for word in words):
    lead = ["with"] if "with" in previous.words and "with" not in words else []
    return previous._replace(words=[*lead, *tokens], before=[], subject=[])
  return None


def _counted(clause):
  """The clause without "twice", "three times" and "for five seconds", which it then says in numbers."""
  text = " ".join(clause.words)
  number = r"(\d+(?:\.\d+)?|" + "|".join(_NUMBERS) + r")"
  times, seconds = 1, None
  about = r"(?i)\b(?:for )?(?:about |around |roughly |exactly )?(?:a )?"
  found = (re.search(about + r"(\d+(?:\.\d+)?) ?(s|secs?|seconds?|mins?|minutes?)\b(?: long)?", text)
           or re.search(rf"{about}{number}(?: of)?(?: a)? (secs?|seconds?|mins?|minutes?)\b(?: long)?", text))
  if found:
    seconds = _number(found[1]) * (60 if found[2].lower().startswith("min") else 1) or None
    text = _cut(text, found) if seconds else text
  found = re.search(r"(?i)\b(twice|thrice)\b(?! as)", text) or re.search(
      rf"(?i)\b(?:a )?{number}(?: of)?(?: more)? times\b(?: in a row)?", text)
  if found:
    times = {"twice": 2, "thrice": 3}.get(found[1].lower()) or int(_number(found[1]))
    text = _cut(text, found) if times > 0 else text
  together = re.search(rf"(?i)\b(?:{'|'.join(_TOGETHER)})\b", text)
  text = text if together is None else _cut(text, together)
  before = [word for word in clause.before if word.lower() not in _TOGETHER]
  return clause._replace(words=text.split(), before=before, times=max(times, 1), seconds=seconds,
                         at_once=together is not None or before != clause.before)


def _number(word):
  return float(_NUMBERS.get(word.lower(), 0) if not word[0].isdigit() else word)


def _cut(text, found):
  return (text[:found.start()].rstrip() + " " + text[found.end():].lstrip()).strip()


# --- from clauses to segments ----------------------------------------------------------------------------------------


def _is_person(subject):
  return any(word.lower() in _PEOPLE for word in subject)


def _subject(clauses):
  """The words for who moves, or None where there are several: a body is one person."""
  said = [[word.lower() for word in clause.subject] for clause in clauses if clause.subject]
  named = [words for words in said if words[-1] not in _PRONOUNS]
  if {"he", "she"} <= {words[-1] for words in said}:
    return None
  first = next(iter(named), next(iter(said), ["a", "person"]))
  for words in named:
    if words != first and (words[0] not in ("the", "this", "that") or set(words) & _OTHER):
      return None
  if named and named[0][0] in ("the", "this") and len(named) > 1:
    first = named[0]
  return first


def _begun(pieces):
  """The pieces with what they say to stop before it, where they have not said that it is done: "stops walking"."""
  found, done = [], set()
  for kind, clause in pieces:
    ended = clause.words[0].lower() if clause.verb in ("stop", "finish", "quit") and clause.words else ""
    if is_ing(ended) and not done:
      whole = _clause(clause.words)
      found.append((kind, whole._replace(subject=clause.subject)))
      kind = "then"
    done.add(clause.verb)
    found.append((kind, clause))
  return found


def _arranged(pieces):
  """Lists of clauses that go on at once, in the order in which they are done; None where a body cannot do so."""
  groups, listed, subordinate, before_kind = [], False, [], ""
  for kind, clause in pieces:
    if kind in ("", "lead after", "lead while", "lead before", "lead until"):
      groups.append([clause])
    elif kind == "main after":
      groups.append([clause])
    elif kind == "main while":
      if not _fit(groups[-1], clause):
        return None  # "while walking, she turns left"
      groups[-1].append(clause)
    elif kind in ("main before", "main until"):
      subordinate, groups = groups, [[clause]]
    elif kind == "while" or clause.at_once and kind in ("and", ",") or kind == "," and is_ing(clause.form) or (
        kind == "and" and is_ing(clause.form) and before_kind == "while"):
      kind = "while"
      groups.append([clause]) if not _fit(groups[-1], clause) else groups[-1].append(clause)
    elif kind == "and" and not listed and _at_once(groups[-1], clause):
      groups[-1].append(clause)
    elif kind == "after":
      groups.insert(len(groups) - 1, [clause])
    else:
      listed = kind == ","
      groups.append([clause])
    before_kind = kind
  return groups + subordinate


def _at_once(group, clause):
  """Whether "and" means at the same time: the legs go on, or each arm has its own to do."""
  if not _fit(group, clause):
    return False
  parts = {_part(one) for one in [*group, clause]}
  if "legs" in parts:
    return all(actions.goes_on(one.verb, _lower(one.words)) or is_ing(one.form)  # "is sitting and clapping"
               for one in [*group, clause] if _part(one) == "legs") and parts <= {"legs", "arms", "head"}
  return parts == {"arms", "head"} or parts == {"arms"} and {one.verb for one in [*group, clause]} <= _OF_EACH_ARM


def _fit(group, clause):
  """Whether the parts of the body that move are different ones, so that all of it is done at once."""
  for one in group:
    ours, theirs = _part(one), _part(clause)
    if not ours or not theirs:
      return False
    if ours == theirs:
      a, b = (actions.sides_of(_lower(x.words)) for x in (one, clause))
      if ours != "arms" or not a or not b or set(a) & set(b):
        return False
    if {ours, theirs} == {"legs", "body"}:
      return False
  return True


def _part(clause):
  return actions.part_of(clause.verb, _lower(clause.words))


def _lower(words):
  return [word.lower() for word in words]


def _segment(group, subject):
  """The Segment of clauses that go on at once; whose part leads carries the others."""
  ordered = sorted(group, key=lambda clause: actions.PARTS.index(_part(clause)) if _part(clause) else -1)
  found = []
  for clause in ordered:
    found.append(_action(clause, subject))
    hands = _HANDS_UP.search(found[-1].words.lower())
    if hands and found[-1].part == "legs":
      words = _cut(found[-1].words, hands)
      found[-1] = found[-1]._replace(words=words, prompt=f"{' '.join(subject)} {words}")
      side = hands[1].strip()
      raised = f"raises the {side} hand" if side else (
          "raises both hands" if hands[2].endswith("s") else "raises a hand")
      found.append(Action(f"{' '.join(subject)} {raised}", raised, "arms",
                          (side,) if side else ("left", "right") if hands[2].endswith("s") else (), held=True))
  seconds = [clause.seconds for clause in ordered if clause.seconds is not None]
  return Segment(found[0], tuple(found[1:]), seconds[0] if seconds else None)


def _action(clause, subject):
  who = " ".join(subject)
  if clause.verb in actions.RESTS and not (clause.verb == "rest" and clause.words) or clause.verb in (
      "stand", "stay") and clause.words[:1] == ["still"] or clause.verb in ("finish", "quit"):
    return Action(f"{who} {REST}", REST, "legs", verb="stand")
  plural = subject[-1] in _PLURAL or (len(subject) > 1 and _NUMBERS.get(subject[0], 1) > 1)
  form = clause.form
  if form == clause.verb or is_ing(form):
    form = clause.verb if plural else _third(clause.verb)
  words = " ".join([*_lower(clause.before), form, *clause.words])
  words = re.sub(r"\s+([,.;:!?%)])", r"\1", words).rstrip(" .,;:!?-–—").replace("( ", "(")
  return Action(f"{who} {words}", words, _part(clause), actions.sides_of(_lower(clause.words)), clause.times,
                clause.verb)


def _third(verb):
  """walk -> walks, carry -> carries, punch -> punches."""
  if verb in ("be", "have"):
    return {"be": "is", "have": "has"}[verb]
  if verb.endswith("y") and verb[-2:-1] not in "aeiou":
    return verb[:-1] + "ies"
  return verb + ("es" if verb.endswith(("s", "sh", "ch", "x", "z", "o")) else "s")


def _without_repeated_rests(segments):
  """Who stops and then stands still rests once."""
  return tuple(one for one, before in zip(segments, (None, *segments))
               if before is None or not (one.rests and before.rests and one.seconds is None))
