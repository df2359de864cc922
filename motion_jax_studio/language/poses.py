"""Pauses and held poses: a seated body stays seated while it waits, and its arms may act meanwhile."""
from motion_jax_studio.language import lexicon, parts
from motion_jax_studio.language.actions import Segment, still
from motion_jax_studio.language.clause import lower
from motion_jax_studio.language.lexicon import HOLD, PAUSE


def is_hold(verb, words):
  """Whether a verb and the words after it say that nothing moves: "stays seated", "holds the pose", "does not move"."""
  if verb in ("stay", "remain", "hold", "keep"):
    return words <= lexicon.POSE_WORDS and (verb in ("stay", "remain") or bool(words & lexicon.POSE_NOUNS))
  return verb == "do" and words in ({"not", "move"}, {"nothing"})


def holding(segment):
  """[the segment, a hold of its duration] for a raised hand or a low pose with a duration; else [the segment]."""
  action = segment.action
  if segment.seconds is None or segment.simultaneous or action.times > 1 or not (
      action.verb in ("raise", "lift") and action.part == "arms" or action.verb in lexicon.LOW):
    return [segment]
  return [segment._replace(seconds=None), Segment(still(action.subject, HOLD), (), segment.seconds)]


def with_poses(segments, who):
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
    elif action.words == PAUSE and (low or before and before.hold_pose and not segment.simultaneous):
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
  return parts.stays_low(action.verb, action.part, lower(action.words.split()))


def _without_repeated_pauses(segments):
  """The segments without a pause of no given duration after another pause: "stops and stands still"."""
  return [segment for segment, before in zip(segments, (None, *segments))
          if before is None or not (segment.is_pause and before.is_pause and segment.seconds is None)]
