"""A sentence becomes a Plan, by rule: no language model and no learning.

  parse("After sitting down, an old man walks forward while waving, then stops.").summary
  -> sits down | walks forward + waves | stands still, all of them of "an old man"

The steps: the text is cut into clauses (`clauses`, with `light_verbs`, `ellipsis` and `counting`), the clauses are put
in order (`ordering`) and made into segments, in which poses are kept (here); each `Action` fills its slots from its
words (`slots`). Words that no rule covers stay with the action before them: "up and down", "with anger and pride".
"""
import re
from collections.abc import Callable

from motion_jax.text.morphology import is_participle, is_past, third_person, verb_of
from motion_jax_studio.language import lexicon, parts
from motion_jax_studio.language.actions import Action, Segment, pause, still
from motion_jax_studio.language.clauses import clauses_of, fragments_of, parts_of
from motion_jax_studio.language.lexicon import HOLD, PAUSE
from motion_jax_studio.language.meaning import Meanings, translated
from motion_jax_studio.language.ordering import in_order, subject_of
from motion_jax_studio.language.path_shapes import is_gait
from motion_jax_studio.language.plan import Plan
from motion_jax_studio.language.words import normalize

_WHERE_TO = {"to", "the", "where", "toward", "towards", "in"}  # after "walks back"
_NOT_FORWARD = frozenset("backward backwards back sideways turns turn circle around diagonally".split())


def parse(text: str, known: Callable[[str], bool] | None = None, meanings: Meanings | None = None) -> Plan:
  """Parse one or more sentences into a Plan; text that cannot be split is one segment, as it was written.

  known(words): whether a model has learned these words as one action; they stay together ("walks and turns left"), as
  does any walk with the turn to a side after it. meanings: replacements of verbs that the model does not know.
  """
  clauses = parts_of(fragments_of(text))
  whole = [_action(clause, clause.subject or lexicon.DEFAULT_SUBJECT) if clause else None
           for _, clause in _clauses(clauses, meanings, lambda text: True)]
  split = _segments(text, _clauses(clauses, meanings))
  segments = split if known is None else _with_turns(
      None if known(text) else _segments(text, _clauses(clauses, meanings, known)), text)
  actions = tuple(filter(None, whole)) if split is None else tuple(
      action for segment in split for action in segment.actions)
  plain = (Segment(Action(text, text)),)
  return Plan(text, segments or plain, actions, whole[0] if len(whole) == 1 else None, split or plain)


def _clauses(clauses, meanings, keep_together=None):
  return [(kind, clause and translated(clause, meanings)) for kind, clause in clauses_of(clauses, keep_together)]


def _segments(text, joined):
  """The segments of a text with the clauses [(connector, clause)]; None if it stays one segment as it was written."""
  clauses = [clause for _, clause in joined]
  if not clauses or None in clauses:
    return None
  subject = subject_of(clauses)
  groups = subject and in_order(joined)
  if not groups:
    return None
  who = " ".join(subject)
  segments = [part for group in groups for part in _holding(_segment(group, subject))]
  if any(clause.steps for clause in groups[-1]) and segments[-1].seconds:  # after its steps the body stands there
    segments.append(pause(who, None))
  posed = _with_poses(_with_ways_back(segments), who)
  return None if Plan(text, posed).is_plain else posed


def _with_ways_back(segments):
  """The segments, with a turn and a walk back as a turn around and a walk forward to where the last walk began."""
  changed = list(segments)
  for place, (turn, back) in enumerate(zip(segments, segments[1:])):
    turning, walking = turn.action, back.action
    if not (walking.slots.leads_back and is_gait(walking.verb)) or turning.verb not in lexicon.TURNING:
      continue
    sides = {"left", "right"} & set(turning.words.split())
    words = " ".join(["turns around", *(f"to the {side}" for side in sides if len(sides) == 1)])
    changed[place] = turn._replace(action=turning.replace(words=words, part="legs", verb="turn", reworded=True))
    verb, rest = walking.words.split("back", 1)
    words = f"{verb}forward{'' if _WHERE_TO & {*rest.split()[:1]} else rest}"
    changed[place + 1] = back._replace(action=walking.replace(words=words, reworded=True, goes_back=True))
  return changed


def _with_turns(segments, text):
  """The segments, with each walk or run and the turn to a side after it merged as in captions: "walks forward and turns
  left"; None if a plain plan is left. A turn before another walk stays an action of its own."""
  joined: list[Segment] = []
  for segment, after in zip(segments or (), [*(segments or ())[1:], None]):
    before, turn = joined[-1] if joined else None, segment.action
    walks_again = after is not None and is_gait(after.action.verb)
    if before and _is_walk_forward(before) and _is_turn_to_a_side(turn) and not any((
        walks_again, segment.simultaneous, segment.seconds, turn.times > 1)):
      joined[-1] = before._replace(action=before.action.replace(words=f"{before.action.words} and {turn.words}"))
    else:
      joined.append(segment)
  return tuple(joined) if joined and not Plan(text, tuple(joined)).is_plain else None


def _is_turn_to_a_side(action):
  """Whether it is a turn to the left or right and no more: "turns sharply to the left"."""
  words = normalize(action.words).split()
  return [word for word in words if word != "to" and not word.endswith("ly")] in (
      [turn, side] for turn in ("turn", "turns") for side in ("left", "right"))


def _is_walk_forward(segment):
  """Whether a segment is a walk or run forward and nothing else."""
  action = segment.action
  return is_gait(action.verb) and not any((segment.simultaneous, segment.seconds, action.times > 1)) and (
      _NOT_FORWARD.isdisjoint(action.words.split()))


def _segment(group, subject):
  """The Segment of simultaneous clauses; the one whose part comes first in PARTS is the base of the motion."""
  ordered = sorted(group, key=lambda clause: parts.PARTS.index(clause.part) if clause.part else -1)
  acting = [_action(clause, subject) for clause in ordered]
  seconds = [clause.seconds for clause in ordered if clause.seconds is not None]
  if not seconds and acting[0].words in (PAUSE, HOLD):
    words = " ".join(ordered[0].words)
    seconds = [time for name, time in lexicon.PAUSE_SECONDS.items() if name in words]
  return Segment(acting[0], tuple(acting[1:]), seconds[0] if seconds else None)


def _action(clause, subject):
  """The Action of a clause, with the subject of the sentence."""
  who, words = " ".join(subject), _words_of(clause, subject)
  after = [word for word in clause.words if word.isalpha()]
  in_the_past = _is_past(clause) and (not clause.subject or clause.subject[-1] in lexicon.PEOPLE)
  rest = set(after) - lexicon.SHORT_TIMES
  keeps_a_limb = bool(parts.limb_postures(words))
  stands = clause.verb in ("stand", "stay") and after[:1] == ["still"] or (
      clause.verb == "stand" and not clause.words and not is_participle(clause.form))
  pauses = clause.verb in lexicon.PAUSING_VERBS and not (clause.verb == "rest" and rest)
  if (stands or pauses) and not keeps_a_limb:
    return still(who, reworded=clause.reworded)
  if pauses:  # "stops with the arms crossed"
    clause = clause._replace(verb="stand", form="stand", words=["still", *clause.words])
    words = _words_of(clause, subject)
  if _is_hold(clause.verb, rest):
    return still(who, HOLD).replace(prompt=f"{who} {words}")
  return Action.of(who, words, clause.part, sides=parts.sides_of(clause.words), times=clause.times,
                   verb=clause.verb, reworded=clause.reworded or in_the_past, counts_steps=clause.steps)


def _is_past(clause):
  """Whether a clause is in the past tense; a passive stays as it is, and so does "a blind folded person"."""
  return is_past(clause.form) and not {"is", "are", *lexicon.DETERMINERS} & set(clause.before)


def _words_of(clause, subject):
  """The words of a clause without its subject, the verb in the third person: "slowly walks forward"."""
  is_plural = subject[-1] in lexicon.PLURAL_SUBJECTS
  form = clause.form
  if form == clause.verb or is_participle(form) or _is_past(clause):
    base = clause.verb if form == clause.verb else verb_of(form)
    form = base if is_plural else third_person(base)
  words = " ".join([*clause.before, form, *clause.words])
  return re.sub(r"\s+([,.;:!?%)])", r"\1", words).rstrip(" .,;:!?-–—").replace("( ", "(")


# --- pauses and held poses: a seated body stays seated while it waits, and its arms may act meanwhile ---

def _is_hold(verb, words):
  """Whether a verb and the words after it say that nothing moves: "stays seated", "holds the pose", "does not move"."""
  if verb in ("stay", "remain", "hold", "keep"):
    return words <= lexicon.POSE_WORDS and (verb in ("stay", "remain") or bool(words & lexicon.POSE_NOUNS))
  return verb == "do" and words in ({"not", "move"}, {"nothing"})


def _holding(segment):
  """[the segment, a hold of its duration] for a raised hand or a low pose with a duration; else [the segment]."""
  action = segment.action
  is_kept = action.verb in lexicon.LOW | {"raise", "lift"} and action.times == 1 and not segment.simultaneous
  if segment.seconds is None or not is_kept:
    return [segment]
  return [segment._replace(seconds=None), Segment(still(action.subject, HOLD), (), segment.seconds)]


def _with_poses(segments, who):
  """The segments, with a low pose (sitting, lying) held through pauses and through actions of arms and head after it.

  A hold with no pose before it becomes a pause, except "stays seated", which becomes an action.
  """
  posed, low = [], False
  for segment in map(_without_simultaneous_pauses, _without_repeated_pauses(segments)):
    action, before = segment.action, posed[-1] if posed else None
    if action.words == HOLD and before is None and lexicon.LOW_POSES & set(action.prompt.split()):
      action = action.replace(words=action.prompt.removeprefix(who + " "))
    elif action.words == HOLD and before is None:
      action = action.replace(words=PAUSE, reworded=True)
    elif action.words == PAUSE and low:
      action = action.replace(words=HOLD)
    elif low and all(map(_stays_low, (action, *segment.simultaneous))):
      segment = segment._replace(simultaneous=(action, *segment.simultaneous))
      action = still(who, HOLD)
    posed.append(segment._replace(action=action))
    low = action.verb in lexicon.LOW or low and posed[-1].hold_pose
  return tuple(posed)


def _without_simultaneous_pauses(segment):
  """The segment without pauses and holds during its action: "steps back" of "steps back while holding still"."""
  acting = tuple(action for action in segment.simultaneous if action.words not in (PAUSE, HOLD))
  return segment._replace(simultaneous=acting)


def _stays_low(action):
  return parts.stays_low(action.verb, action.part, action.words.split())


def _without_repeated_pauses(segments):
  """The segments without a pause of no given duration after another pause: "stops and stands still"."""
  return [segment for segment, before in zip(segments, (None, *segments))
          if before is None or not (segment.is_pause and before.is_pause and segment.seconds is None)]
