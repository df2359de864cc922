"""Sentences cut into clauses, one for each thing that is done: who, what, with which words, how often, how long.

`sentences` puts them in order. What is no action of its own stays with the words before it.
"""
import re
from typing import NamedTuple

from motion_jax.data.tagger import tag_words
from motion_jax.text import actions
from motion_jax.text.light_verbs import BLOWS, LIGHT, reworded

NUMBERS = {word: number for number, word in enumerate(
    "zero one two three four five six seven eight nine ten eleven twelve".split())} | {
        "a": 1, "an": 1, "half": 0.5, "couple": 2, "few": 3, "several": 3, "many": 4}
_TOKEN = re.compile(r"\d+(?:\.\d+)?|\w+(?:['’-]\w+)*|\S", re.UNICODE)
_NOT = re.compile(r"(?i)\b(do|does|did)n['’]t\b")
_PEOPLE = set("person man woman boy girl child kid guy lady figure human dancer boxer player character people men "
              "women children somebody someone anybody everyone one he she they i you we it who him her them athlete "
              "actor soldier robot zombie giant thug teenager adult".split())
_DETERMINERS = {"the", "a", "an", "this", "that"}
_ACTORS = {"he", "she", "they", "i"}
_LONGEST_SUBJECT = 5  # "the tired old man"
PRONOUNS = {"he", "she", "they", "it", "who", "i", "you", "we"}
_POSSESSIVES = {"his", "her", "their", "its", "my", "your", "our"}
_NUMBER = r"(\d+(?:\.\d+)?|" + "|".join(NUMBERS) + r")"
_TIMES = re.compile(r"(?i)(?<!than )(?<!at )\b(once|twice|thrice)\b(?! as| more| again)|"
                    rf"\b(?:a )?{_NUMBER}(?: of)?(?: more)? times\b(?: in a row)?")
_EXACT = "|".join(word for word in NUMBERS if word not in ("zero", "half", "few", "several", "many"))
_COUNTED_STEPS = re.compile(rf"(?i)(?<!up )(?<!down )\b(\d+|{_EXACT})(?: of)?(?: more| short| small| big| large| long| "
                            r"side| quick| tiny| giant)* steps?\b(?! by| in place)")
_STEPS_BY = set("take step walk go move march run jog make do".split())
# Seconds of a step, and of a single one: of 24 walks of `cmdm-small`, forward, back and sideways, that last 1.6, 2.2,
# 2.8 and 4 s the median has 3, 4, 5 and 7 steps, those that are cut off at the ends among them.
_STEP, _STEP_BACK, _FIRST_STEP = 0.55, 0.65, 0.8
_BACK = {"back", "backward", "backwards"}
_LONG = 40  # words of a clause behind which no further one begins unmarked
_ONE_MORE = ("a", "an", "another")
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
_SIDES = {"left": "right", "right": "left"}
_LIMBS = {"hand", "arm", "leg", "foot", "knee", "elbow", "hands", "arms"}
_OF_A_LIMB = set("the with on left right both other one".split())
_GAITS = {"walk", "run", "jog", "march", "sneak", "stroll", "go"}
_CHANGES_PACE = re.compile(
    r"(?:(?:gradually|suddenly|then|slowly|quickly|abruptly) )?(?:(?P<slower>slows?|decelerates?|(?:(?:goes|gets) )?"
    r"slower)|speeds?|accelerates?|(?:(?:goes|gets) )?faster|picks up (?:the |some )?(?:pace|speed))"
    r"(?: up| down)?(?: (?:gradually|suddenly|a bit|a little|again))?(?: (?:in)?to an? (?P<gait>walk|run|jog|sprint))?")
_SHAPES = re.compile(r"(?i)(?:in|along) an? (?:\w+ )?(?:circle|loop|arc|curve|semicircle|spiral)\b")
_GOES_ON = re.compile(r"(?:goes|moves|carries) on|keeps going|continues|resumes|proceeds")
_BEHIND_ONCE = set("with on to in at from by and again more".split())  # "kicks left, then once with the right"
_PATHS = {"u-turn", "circle", "circles", "loop", "zigzag", "arc", "detour"}  # shapes of a way that is walked
_LONGEST = max(len(words.split()) for words in _CONNECTORS)


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


def pieces_of(text, known):
  """[(how it is joined to what is before, clause)]; joins are keys of `_CONNECTORS`, "" at the start."""
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
  return _merged(found, known)


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


def _merged(fragments, known):
  """Fragments [(kind, connector's tokens, tokens)] to [(kind, clause)]: what is no action of its own stays with the
  words before it, connector and all."""
  fragments = _with_main_clause(fragments)
  result: list = []  # [kind, tokens, clause or None]
  lead = ""          # a subordinate clause in front waits for its main clause
  for kind, said, tokens in fragments:
    clause = clause_of(tokens) or (_unknown_verb(tokens) if kind == "then" else None)
    if not result:
      lead = kind if kind in ("before", "after", "while", "until") else ""
      if lead and clause and clause.subject and not _is_person(clause.subject) and len(fragments) > 1:
        lead = ""
        continue  # "when the music starts, the man dances"
      result.append([lead and f"lead {lead}" or "", tokens, clause])
      continue
    previous = result[-1]
    if previous[2] is None and kind == "," and clause and is_ing(clause.form) and _is_person(previous[1]) and not lead:
      result[-1] = ["lead while", tokens, clause._replace(subject=previous[1])]  # "a person, walking forward, waves"
      lead = "while"
      continue
    more = None if previous[2] is None else _more_of_it([one for _, _, one in result if one], kind, tokens, clause)
    clause = clause if more is None else more
    apart = more is not None or clause is not None and previous[2] is not None and (
        _stands_alone(kind, clause, tokens, previous))
    if apart and kind in ("and", "while") and known(" ".join([*previous[1], *said, *tokens])):
      apart = False
    if not apart:
      previous[1] += [*said, *tokens]
      again = clause_of(previous[1])
      if previous[2] is not None and (previous[2].reworded or again is not None and again.reworded):
        previous[2] = again  # "takes a bow and a step back", "goes ahead and to the left without turning"
      elif previous[2] is not None:
        previous[2].words.extend([*said, *tokens])
      elif clause is not None:
        previous[2] = clause_of(previous[1])
      continue
    if lead and kind in (",", "then", "and") and (kind != "and" or clause.subject):
      kind, lead = f"main {lead}", ""
    result.append([kind, tokens, clause])
  return [(kind, clause and _counted(clause)) for kind, _, clause in result]


def _with_main_clause(fragments):
  """The fragments, the first parted where its main clause begins without a comma: "after she sits she gets up"."""
  if not fragments or fragments[0][0] not in ("before", "after", "while", "until"):
    return fragments
  (kind, said, tokens), *rest = fragments
  words = lower(tokens)
  for at in range(1, len(words)):
    clause = clause_of(tokens[at:]) if words[at] in _ACTORS | _DETERMINERS else None
    subject = lower(clause.subject) if clause is not None else []
    begun = subject and subject[-1] in _PEOPLE and not is_ing(clause.form) and not _DETERMINERS & set(subject[1:])
    if begun and len(subject) <= _LONGEST_SUBJECT and clause_of(tokens[:at]) is not None:
      return [(kind, said, tokens[:at]), (",", [","], tokens[at:]), *rest]
  return fragments


def _stands_alone(kind, clause, tokens, previous):
  """Whether a fragment behind a connector is an action, and not more words of the one before."""
  if clause.subject and not _is_person(clause.subject):
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
    return Clause(subject, before, verb, form, behind)
  form = meant.participle if is_ing(form) else meant.verb
  return Clause(subject, before, meant.verb, form, meant.words, meant.times, reworded=True)


def _unknown_verb(tokens):
  """The clause of "then warms them", whose verb is in no list."""
  word = tokens[0].lower()
  if not re.fullmatch(r"[a-z]{3,}s", word) or word.endswith(("ss", "us", "is")) or word in _DIRECTIONS or (
      tag_words([word])[0][1] != "NOUN"):
    return None
  return Clause([], [], word[:-1], word, tokens[1:])


def _first_verb(words, tags):
  for at, (word, tag) in enumerate(zip(words, tags)):
    before = tags[at - 1] if at else ""
    if at and words[at - 1] in _POSSESSIVES or "jumping jack" in " ".join(words[max(at - 1, 0):at + 2]):
      continue  # "regains his balance"
    if at > 1 and words[at - 1] in ("left", "right") and words[at - 2] in _ONE_MORE and actions.verb_of(word) == word:
      continue  # "a right turn"
    if tag in ("VERB", "AUX") and word not in ("being", "been", "having"):
      return at
    if tag in ("NOUN", "ADJ") and actions.verb_of(word) and before not in ("DET", "ADJ", "NUM", "ADP") and (
        before != "PRON" or words[at - 1] in PRONOUNS):
      return at
  return None


def _more_of_it(done, kind, tokens, clause):
  """The clause of words that go on from the clauses before: with no verb of their own, with that of a change of pace,
  or with one that says to go on."""
  previous, words = done[-1], lower(tokens)
  gone = next((one for one in reversed(done) if one.verb in _GAITS), None)
  if gone is not None and _GOES_ON.fullmatch(" ".join(words)):
    return gone._replace(before=[], subject=[])
  changed = _other_pace(previous, tokens)
  taken = previous.verb in LIGHT or previous.reworded or not {"step", "steps"}.isdisjoint(lower(previous.words))
  if changed is None and taken and _steps(words) and kind in ("and", ",", "then"):
    return Clause([], [], "take", "take", list(tokens))  # "and one step back"
  if changed is not None or clause is not None:
    return changed
  if kind == "then":
    return _elliptic(previous, tokens)
  if kind not in ("and", ","):
    return None
  # "jumps forward twice and backward once", "punches left, right"; "walks back and forth" stays what it is.
  counted = all(_without_times(some)[1] is not None for some in (previous.words, tokens))
  blow = previous.verb in BLOWS and words in (["left"], ["right"])
  return _elliptic(previous, tokens) if counted or blow else None


def _steps(words):
  """Whether words are no more than "two steps back"."""
  return words[1:2] in (["step"], ["steps"]) and words[0] in NUMBERS | dict.fromkeys(_ONE_MORE) and (
      set(words[2:]) <= _DIRECTIONS | {"to", "the"})


def _other_pace(previous, tokens):
  """The clause of "speeds up" behind "walks slowly", of "slows down to a walk" behind "runs"; None of other words."""
  found = _CHANGES_PACE.fullmatch(" ".join(lower(tokens)))
  if found is None or previous.verb not in _GAITS:
    return None
  if found["gait"]:
    return Clause([], [], found["gait"], found["gait"], [])
  words = " ".join(previous.words).replace(" at first", "").split()
  words = [word for word in words if not word.lower().endswith("ly") and word.lower() != "fast"]
  return previous._replace(words=[*words, "slowly" if found["slower"] else "quickly"], before=[], subject=[])


def _elliptic(previous, tokens):
  """The clause of "then right" behind "turns left", of "then the right hand" behind "raises the left hand"."""
  tokens, times = _without_times(tokens)
  if times is not None:  # "then twice with the right hand"
    again = previous._replace(words=_without_times(previous.words)[0], before=[], subject=[])
    found = _elliptic(previous, tokens) if tokens else again
    return found and found._replace(times=times)
  words = [token.lower() for token in tokens]
  if words and all(word.endswith("ly") for word in words):
    return previous._replace(words=[word for word in previous.words if not word.endswith("ly")] + list(tokens),
                             before=[], subject=[])
  adverbs = {word for word in words if word.endswith("ly")}
  if words and all(word in _DIRECTIONS | {"to", "the"} | adverbs for word in words) and words != ["again"] and not (
      _LIMBS.intersection(lower(previous.words)) and words[-1] in _SIDES and "to" not in words) and (
          _DIRECTIONS.intersection(lower(previous.words))):
    shape = _SHAPES.match(" ".join(previous.words))  # "in a circle to the left, then to the right"
    return previous._replace(words=[*(shape[0].split() if shape else []), *tokens], before=[], subject=[])
  if words[:1] == ["in"] and previous.verb in _GAITS:  # "in a circle, then in a straight line"
    return previous._replace(words=list(tokens), before=[], subject=[])
  if words and words[0] == "like":  # "walks normally, then like an old man"
    return previous._replace(words=[word for word in previous.words if word.lower() != "normally"] + list(tokens),
                             before=[], subject=[])
  if len(words) == 2 and words[0] in _ONE_MORE and actions.verb_of(words[1]):  # "followed by a jump"
    return Clause([], [], actions.verb_of(words[1]), actions.verb_of(words[1]), [])
  taken = reworded("take", tokens, NUMBERS)
  if taken is not None:  # "then a right turn", "followed by two bows"
    return Clause([], [], taken.verb, taken.verb, taken.words, taken.times, reworded=True)
  if _steps(words):  # "then a step back"
    return Clause([], [], "take", "take", list(tokens))
  limb = next((word for word in lower(previous.words) if word in _LIMBS), "")
  if words and set(words) <= _POSSESSIVES | _LIMBS | _OF_A_LIMB and (
      words[-1] in _LIMBS or limb and words[-1] in (*_SIDES, "other")):
    lead = ["with"] if "with" in previous.words and "with" not in words else []
    lead += ["the"] if len(words) == 1 and words[0] in _SIDES else []
    side = next((_SIDES[word] for word in lower(previous.words) if word in _SIDES), "other")
    said = [side if word.lower() == "other" else word for word in tokens]
    return previous._replace(words=[*lead, *said, *([] if words[-1] in _LIMBS else [limb])], before=[], subject=[])
  return None


def _without_times(tokens):
  """(the tokens without "twice" or "three times", the number); None for no number."""
  text = " ".join(tokens)
  found = _TIMES.search(text)
  return (tokens, None) if found is None else (without(text, found).split(), max(_times(found), 1))


def _times(found):
  word = next(filter(None, found.groups())).lower()
  return {"once": 1, "twice": 2, "thrice": 3}.get(word) or int(_number(word))


def _counted(clause):
  """The clause without "twice", "three times" and "for five seconds", which it then says in numbers."""
  text = " ".join(clause.words)
  times, seconds = clause.times, None
  about = r"(?i)\b(?:for )?(?:about |around |roughly |exactly )?(?:a )?"
  found = (re.search(about + r"(\d+(?:\.\d+)?) ?(s|secs?|seconds?|mins?|minutes?)\b(?: long)?", text)
           or re.search(rf"{about}{_NUMBER}(?: of)?(?: a)? (secs?|seconds?|mins?|minutes?)\b(?: long)?", text))
  if found:
    seconds = _number(found[1]) * (60 if found[2].lower().startswith("min") else 1) or None
    text = without(text, found) if seconds else text
  steps = seconds is None and clause.verb in _STEPS_BY and _COUNTED_STEPS.search(text)
  if steps:
    back = not _BACK.isdisjoint(text.lower().split())
    seconds = max(_number(steps[1]) * (_STEP_BACK if back else _STEP), _FIRST_STEP)
    if clause.verb in ("take", "step", "make", "do") or back:  # as captions say it
      verb = "walk" if clause.verb not in ("run", "jog", "march") else clause.verb
      form = "walking" if is_ing(clause.form) else verb
      way = " ".join("backward" if word in _BACK else word for word in without(text, steps).split())
      clause = clause._replace(verb=verb, form=form, reworded=True)
      way = f"to the {way}" if way in _SIDES else way
      text = f"sideways {way}" if way.startswith("to the ") else way or "forward"
  found = _TIMES.search(text)
  if found:
    times = _times(found)
    text = without(text, found) if times > 0 else text
  together = re.search(rf"(?i)\b(?:{'|'.join(_TOGETHER)})\b", text)
  text = text if together is None else without(text, together)
  before = [word for word in clause.before if word.lower() not in _TOGETHER]
  return clause._replace(words=text.split(), before=before, times=max(times, 1), seconds=seconds,
                         steps=bool(steps), at_once=together is not None or before != clause.before)


def _number(word):
  return float(NUMBERS.get(word.lower(), 0) if not word[0].isdigit() else word)


def without(text, found):
  return (text[:found.start()].rstrip() + " " + text[found.end():].lstrip()).strip()


def is_ing(word: str) -> bool:
  return word.endswith("ing") and bool(actions.verb_of(word)) and actions.verb_of(word) != word


def _is_person(subject):
  return any(word.lower() in _PEOPLE for word in subject)


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
