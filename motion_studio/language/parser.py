"""Sentences of several actions, understood by rule: what comes after what, what goes on at the same time, how long.

  understand("After sitting down, an old man walks forward while waving, then stops.")
  -> sits down | walks forward + waves | stands still, all of them of "an old man"

In a row: then, after that, next, finally, before, after, until, a full stop, a semicolon, commas between verbs, "and"
between actions of one part of the body or of which one is done once ("sits down and stands up"). At once: while, as,
during, at the same time, a participle ("walks, waving the left hand"), "with the right hand raised", and "and" where
the legs merely go on ("walks and waves"). Whatever is not surely understood stays in its clause as it was said: "up and
down", "back and forth" and "with anger and pride" are never parted. No language model and no learning: a list of verbs,
a tagger (`text.tagger`) and the rules here and in `clauses`.
"""
import re
from collections.abc import Callable

from motion_jax.text.morphology import third_person
from motion_studio.language import actions
from motion_studio.language.clause import NUMBERS, PRONOUNS, clause_of, fit, is_ing, lower, part_of, without
from motion_studio.language.clauses import fragments_of, joined
from motion_studio.language.lexicon import HOLD, PAUSE
from motion_studio.language.plan import Action, Plan, Segment, pause

_LOW_POSE = set("seated sitting low down crouched crouching kneeling squatting lying bent".split())
_STAYED = _LOW_POSE | set("still there here put up standing motionless frozen in on the that this place position pose "
                          "floor chair like so as".split())
_POSE = set("it them that this still pose position posture there steady".split())
_HELD = _POSE | set("the his her their its up out high down in place air like so".split())
_FOR_A = {"a moment": 1.0, "a while": 4.0, "a long time": 6.0}  # seconds of such a rest
_WHILE = set("for a little short long while moment bit time second".split())
_PLURAL = set("people men women children they we i you".split())
_OTHER = {"another", "other", "second", "else", "each"}
_OF_EACH_ARM = {"wave", "raise", "lift", "hold", "stretch", "extend", "lower", "swing", "put"}
_TAKEN = re.compile(r"\b(?:take|takes|taking) (?:a|the|another) (?:left|right) turn\b", re.IGNORECASE)
_HANDS_UP = re.compile(r"\bwith (?:(?:his|her|their|its|the|a|an|one|both) )*((?:left |right )?)(hands?|arms?) "
                       r"(?:(?:held|stretched|lifted) )?(?:raised|lifted|up|in the air|high|overhead|"
                       r"(?:above|over) (?:(?:his|her|their|the) )?head)(?: (?:up|high|in the air))?\b")


def parse(text: str, known: Callable[[str], bool] | None = None) -> Plan:
  """The Plan of a sentence, or of several; one segment with the text as it is where it cannot be split.

  known: whether a model has learned such words as one action; these stay together ("walks and turns left").
  """
  parts = fragments_of(text)
  clauses = [clause for _, clause in joined(parts, lambda text: True)]
  whole = tuple(_action(clause, lower(clause.subject) or ["a", "person"]) for clause in clauses if clause is not None)
  split = _segments(text, parts, lambda text: False)
  segments = split if known is None else _segments(text, parts, known)
  actions = whole if split is None else tuple(action for one in split for action in (one.action, *one.simultaneous))
  single = whole[0] if len(whole) == len(clauses) == 1 else None
  plain = (Segment(Action(text, text)),)
  return Plan(text, segments or plain, actions, single, split or plain)


def _segments(text, parts, known):
  """The segments of fragments, None for a text that stays as it is."""
  pieces = [] if known(text) else joined(parts, known)
  clauses = [clause for _, clause in pieces]
  if not clauses or None in clauses:
    return None
  subject = _subject(clauses)
  if subject is None:
    return None
  groups = _arranged(_begun(pieces))
  if groups is None:
    return None
  who = " ".join(subject)
  segments = [part for group in groups for part in _kept_up(_segment(group, subject))]
  if any(clause.steps for clause in groups[-1]) and segments[-1].seconds:  # after three steps the body stands there
    segments.append(pause(who, None))
  if _TAKEN.search(text) and not any(one.simultaneous or one.action.verb in actions.RUNS for one in segments):
    segments = [segment._replace(action=_on_ones_way(segment.action)) for segment in segments]
  found = _with_holds(_without_repeated_rests(segments), who)
  return None if Plan(text, found).is_plain else found


def _subject(clauses):
  """The words for who moves, or None where there are several: a body is one person."""
  said = [[word.lower() for word in clause.subject] for clause in clauses if clause.subject]
  named = [words for words in said if words[-1] not in PRONOUNS]
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
      whole = clause_of(clause.words)
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
      if not fit(groups[-1], clause):
        return None  # "while walking, she turns left"
      groups[-1].append(clause)
    elif kind in ("main before", "main until"):
      subordinate, groups = groups, [[clause]]
    elif kind == "while" or clause.at_once and kind in ("and", ",") or kind == "," and is_ing(clause.form) or (
        kind == "and" and is_ing(clause.form) and before_kind == "while"):
      kind = "while"
      groups.append([clause]) if not fit(groups[-1], clause) else groups[-1].append(clause)
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
  if not fit(group, clause):
    return False
  parts = {part_of(one) for one in [*group, clause]}
  if any(one.steps for one in group):  # "takes three steps and waves"
    return False
  if "legs" in parts:
    return all(actions.goes_on(one.verb, lower(one.words)) or is_ing(one.form)  # "is sitting and clapping"
               for one in [*group, clause] if part_of(one) == "legs") and parts <= {"legs", "arms", "head"}
  return parts == {"arms", "head"} or parts == {"arms"} and {one.verb for one in [*group, clause]} <= _OF_EACH_ARM


def _segment(group, subject):
  """The Segment of clauses that go on at once; whose part leads carries the others."""
  ordered = sorted(group, key=lambda clause: actions.PARTS.index(part_of(clause)) if part_of(clause) else -1)
  found = []
  for clause in ordered:
    found.append(_action(clause, subject))
    hands = _HANDS_UP.search(found[-1].words.lower())
    if hands and found[-1].part == "legs":
      words = without(found[-1].words, hands)
      found[-1] = found[-1]._replace(words=words, prompt=f"{' '.join(subject)} {words}")
      side = hands[1].strip()
      raised = f"raises the {side} hand" if side else (
          "raises both hands" if hands[2].endswith("s") else "raises a hand")
      found.append(Action(f"{' '.join(subject)} {raised}", raised, "arms",
                          (side,) if side else ("left", "right") if hands[2].endswith("s") else (), is_pose=True,
                          subject=" ".join(subject)))
  seconds = [clause.seconds for clause in ordered if clause.seconds is not None]
  if not seconds and found[0].words in (PAUSE, HOLD):
    seconds = [time for words, time in _FOR_A.items() if words in " ".join(lower(ordered[0].words))]
  return Segment(found[0], tuple(found[1:]), seconds[0] if seconds else None)


def _kept_up(segment):
  """Who raises a hand or sits for so many seconds does it, and keeps it up so long."""
  action = segment.action
  if segment.seconds is None or segment.simultaneous or action.times > 1 or not (
      action.verb in ("raise", "lift") and action.part == "arms" or action.verb in actions.LOW):
    return [segment]
  hold = Action(f"{action.subject} {HOLD}", HOLD, "legs", verb="stand", subject=action.subject)
  return [segment._replace(seconds=None), Segment(hold, (), segment.seconds)]


def _action(clause, subject):
  who = " ".join(subject)
  plural = subject[-1] in _PLURAL or (len(subject) > 1 and NUMBERS.get(subject[0], 1) > 1)
  form = clause.form
  if form == clause.verb or is_ing(form):
    form = clause.verb if plural else third_person(clause.verb)
  words = " ".join([*lower(clause.before), form, *clause.words])
  words = re.sub(r"\s+([,.;:!?%)])", r"\1", words).rstrip(" .,;:!?-–—").replace("( ", "(")
  said = [word for word in lower(clause.words) if word.isalpha()]
  if clause.verb in actions.RESTS and not (clause.verb == "rest" and set(said) - _WHILE) or clause.verb in (
      "stand", "stay") and said[:1] == ["still"] or clause.verb in ("finish", "quit"):
    return Action(f"{who} {PAUSE}", PAUSE, "legs", verb="stand", reworded=clause.reworded, subject=who)
  if _is_hold(clause.verb, set(said) - _WHILE):
    return Action(f"{who} {words}", HOLD, "legs", verb="stand", subject=who)
  return Action(f"{who} {words}", words, part_of(clause), actions.sides_of(lower(clause.words)), clause.times,
                clause.verb, reworded=clause.reworded, counts_steps=clause.steps, subject=who)


def _on_ones_way(action):
  """Who takes a turn walks: not "turns left" on the spot, but "walks and makes a left turn"."""
  said = re.fullmatch(r"(turns?) (left|right)", action.words)
  if not said:
    return action
  words = f"{'walk' if said[1] == 'turn' else 'walks'} and {'make' if said[1] == 'turn' else 'makes'} a {said[2]} turn"
  return action._replace(prompt=action.prompt.removesuffix(action.words) + words, words=words, verb="walk")


def _is_hold(verb, words):
  """Whether nothing moves: "stays seated", "remains there", "holds the pose", "keeps it up", "does not move"."""
  if verb in ("stay", "remain"):
    return words <= _STAYED
  if verb in ("hold", "keep"):
    return words <= _HELD and bool(words & _POSE)
  return verb == "do" and words in ({"not", "move"}, {"nothing"})


def _with_holds(segments, who):
  """Who rests behind what is done low, as sitting is, holds still there, and arms or a head that act then act there:
  "sits down and waves". Behind nothing, who holds still stands still, but for who "stays seated", which is an action
  then."""
  found, low = [], False
  for segment in segments:
    action, before = segment.action, found[-1] if found else None
    if action.words == HOLD and before is None and _LOW_POSE & set(action.prompt.split()):
      action = action._replace(words=action.prompt.removeprefix(who + " "))
    elif action.words == HOLD and (before is None or segment.simultaneous and not low):
      action = action._replace(prompt=f"{who} {PAUSE}", words=PAUSE, reworded=True)
    elif action.words == PAUSE and (low or before is not None and before.hold_pose and not segment.simultaneous):
      action = action._replace(prompt=f"{who} {HOLD}", words=HOLD)
    elif low and all(map(_stays_low, (action, *segment.simultaneous))):
      segment = segment._replace(simultaneous=(action, *segment.simultaneous))
      action = Action(f"{who} {HOLD}", HOLD, "legs", verb="stand", subject=who)
    found.append(segment._replace(action=action))
    low = action.verb in actions.LOW or low and found[-1].hold_pose
  return tuple(found)


def _stays_low(action):
  return actions.stays_low(action.verb, action.part, lower(action.words.split()))


def _without_repeated_rests(segments):
  """Who stops and then stands still rests once."""
  return tuple(one for one, before in zip(segments, (None, *segments))
               if before is None or not (one.is_pause and before.is_pause and one.seconds is None))
