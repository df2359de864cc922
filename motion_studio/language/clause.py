"""One clause of a sentence: who, what, with which words, how often, how long."""
import re
from typing import NamedTuple

from motion_jax.text.tagger import tag_words
from motion_studio.language import actions
from motion_studio.language.light_verbs import PACES, reworded

NUMBERS = {word: number for number, word in enumerate(
    "zero one two three four five six seven eight nine ten eleven twelve".split())} | {
        "a": 1, "an": 1, "half": 0.5, "couple": 2, "few": 3, "several": 3, "many": 4}
_NUMBER = r"(\d+(?:\.\d+)?|" + "|".join(NUMBERS) + r")"
_TIMES = re.compile(r"(?i)(?<!than )(?<!at )\b(once|twice|thrice)\b(?! as| more| again)|"
                    rf"\b(?:a )?{_NUMBER}(?: of)?(?: more)? times\b(?: in a row)?")
_EXACT = "|".join(word for word in NUMBERS if word not in ("zero", "half", "few", "several", "many"))
_COUNTED_STEPS = re.compile(
    rf"(?i)(?<!up )(?<!down )(?<!half )\b(?:a )?(\d+|{_EXACT})(?: of)?"
    r"((?: more| short| small| big| large| long| side| tiny| giant| quick| fast| rapid| slow| careful)*) steps?\b"
    r"(?! by| in place| at a time)")
_STEPS_BY = set("take step walk go move march run jog make do".split())
# Seconds of a step, and of a single one: of 24 walks of `cmdm-small`, forward, back and sideways, that last 1.6, 2.2,
# 2.8 and 4 s the median has 3, 4, 5 and 7 steps, those that are cut off at the ends among them.
_STEP, _STEP_BACK, _FIRST_STEP = 0.55, 0.65, 0.8
_PACED = {"quickly": 0.75, "slowly": 1.4}  # times these seconds
_BACK = {"back", "backward", "backwards"}
PEOPLE = set("person man woman boy girl child kid guy lady figure human dancer boxer player character people men "
             "women children somebody someone anybody everyone one he she they i you we it who him her them athlete "
             "actor soldier robot zombie giant thug teenager adult".split())
PRONOUNS = {"he", "she", "they", "it", "who", "i", "you", "we"}
POSSESSIVES = {"his", "her", "their", "its", "my", "your", "our"}
ONE_MORE = ("a", "an", "another")
_LIGHT = {"also", "again", "just", "first", "soon"}
DIRECTIONS = set("left right forward forwards backward backwards back sideways up down around ahead away clockwise "
                 "counterclockwise again".split())
_TOGETHER = ("at the same time", "simultaneously", "at once", "meanwhile")
SIDES = {"left": "right", "right": "left"}


class Clause(NamedTuple):
  """Words of one action: who, what, how often; and where its verb is among the words."""
  subject: list[str]
  before: list[str]   # slowly
  verb: str           # base form
  form: str           # as it was written
  words: list[str]    # behind the verb
  times: int = 1
  seconds: float | None = None
  at_once: bool = False  # with the action before it, as the sentence says in so many words
  reworded: bool = False  # its verb is not the one that was written: "takes a bow"
  steps: bool = False  # so many steps are taken, and no more


def clause_of(tokens):
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
  form, behind = tokens[head].lower(), tokens[head + 1:]
  meant = reworded(verb, behind, NUMBERS)
  if meant is None:
    return _in_steps(Clause(subject, before, verb, form, behind))
  form = meant.participle if is_ing(form) else meant.verb
  return Clause(subject, before, meant.verb, form, meant.words, meant.times, reworded=True)


def _in_steps(clause):
  """The clause, which lasts as long as the steps take that it counts; "takes two steps back" is to walk backward."""
  text = " ".join(clause.words)
  found = _COUNTED_STEPS.search(text) if clause.verb in _STEPS_BY else None
  if found is None or _number(found[1]) < 1:
    return clause
  back = not _BACK.isdisjoint(text.lower().split())
  pace = [PACES[word] for word in found[2].lower().split() if word in PACES][:1]
  paced = _PACED[pace[0]] if pace else 1.0
  seconds = max(round(_number(found[1]) * (_STEP_BACK if back else _STEP) * paced, 2), _FIRST_STEP)
  if clause.verb not in ("take", "step", "make", "do") and not back:
    return clause._replace(seconds=seconds, steps=True)
  # As captions say it.
  verb = clause.verb if clause.verb in ("run", "jog", "march") else "walk"
  way = " ".join("backward" if word in _BACK else word for word in without(text, found).split())
  way = f"to the {way}" if way in SIDES else way
  way = f"sideways {way}" if way.startswith("to the ") else way or "forward"
  way = " ".join([way, *pace])
  form = verb + "ing" if is_ing(clause.form) else verb
  return clause._replace(verb=verb, form=form, words=way.split(), reworded=True, seconds=seconds, steps=True)


def unknown_verb(tokens):
  """The clause of "then warms them", whose verb is in no list."""
  word = tokens[0].lower()
  if not re.fullmatch(r"[a-z]{3,}s", word) or word.endswith(("ss", "us", "is")) or word in DIRECTIONS or (
      tag_words([word])[0][1] != "NOUN"):
    return None
  return Clause([], [], word[:-1], word, tokens[1:])


def _first_verb(words, tags):
  for at, (word, tag) in enumerate(zip(words, tags)):
    before = tags[at - 1] if at else ""
    if at and words[at - 1] in POSSESSIVES or "jumping jack" in " ".join(words[max(at - 1, 0):at + 2]):
      continue  # "regains his balance"
    if at > 1 and words[at - 1] in ("left", "right") and words[at - 2] in ONE_MORE and actions.verb_of(word) == word:
      continue  # "a right turn"
    if tag in ("VERB", "AUX") and word not in ("being", "been", "having"):
      return at
    if tag in ("NOUN", "ADJ") and actions.verb_of(word) and before not in ("DET", "ADJ", "NUM", "ADP") and (
        before != "PRON" or words[at - 1] in PRONOUNS):
      return at
  return None


def counted(clause):
  """The clause without "twice", "three times" and "for five seconds", which it then says in numbers."""
  clause = _in_steps(clause)
  text, times, seconds = " ".join(clause.words), clause.times, clause.seconds
  about = r"(?i)\b(?:for )?(?:about |around |roughly |exactly )?(?:a )?"
  found = (re.search(about + r"(\d+(?:\.\d+)?) ?(s|secs?|seconds?|mins?|minutes?)\b(?: long)?", text)
           or re.search(rf"{about}{_NUMBER}(?: of)?(?: a)? (secs?|seconds?|mins?|minutes?)\b(?: long)?", text))
  if found:
    seconds = _number(found[1]) * (60 if found[2].lower().startswith("min") else 1) or clause.seconds
    text = without(text, found) if seconds else text
  found = _TIMES.search(text)
  if found:
    times = _times(found)
    text = without(text, found) if times > 0 else text
  together = re.search(rf"(?i)\b(?:{'|'.join(_TOGETHER)})\b", text)
  text = text if together is None else without(text, together)
  before = [word for word in clause.before if word.lower() not in _TOGETHER]
  return clause._replace(words=text.split(), before=before, times=max(times, 1), seconds=seconds,
                         steps=clause.steps and seconds == clause.seconds,
                         at_once=together is not None or before != clause.before)


def without_times(tokens):
  """(the tokens without "twice" or "three times", the number); None for no number."""
  text = " ".join(tokens)
  found = _TIMES.search(text)
  return (tokens, None) if found is None else (without(text, found).split(), max(_times(found), 1))


def _times(found):
  word = next(filter(None, found.groups())).lower()
  return {"once": 1, "twice": 2, "thrice": 3}.get(word) or int(_number(word))


def _number(word):
  return float(NUMBERS.get(word.lower(), 0) if not word[0].isdigit() else word)


def without(text, found):
  return (text[:found.start()].rstrip() + " " + text[found.end():].lstrip()).strip()


def is_ing(word: str) -> bool:
  return word.endswith("ing") and bool(actions.verb_of(word)) and actions.verb_of(word) != word


def is_person(subject):
  return any(word.lower() in PEOPLE for word in subject)


def fit(group, clause):
  """Whether the parts of the body that move are different ones, so that all of it is done at once."""
  for one in group:
    ours, theirs = part_of(one), part_of(clause)
    if not ours or not theirs:
      return False
    if ours == theirs:
      a, b = (actions.sides_of(lower(x.words)) for x in (one, clause))
      if ours != "arms" or not a or not b or set(a) & set(b):
        return False
    if {ours, theirs} == {"legs", "body"}:
      return False
  return True


def part_of(clause):
  return actions.part_of(clause.verb, lower(clause.words))


def lower(words):
  return [word.lower() for word in words]
