"""Pauses and poses that are kept: a body that sits stays seated while it waits, and arms may act above it."""
from motion_jax_studio.language import actions, lexicon
from motion_jax_studio.language.clause import lower
from motion_jax_studio.language.lexicon import HOLD, PAUSE
from motion_jax_studio.language.segments import Action, Segment


def is_hold(verb, words):
  """Whether a verb and the words after it say that nothing moves: "stays seated", "holds the pose", "does not move"."""
  if verb in ("stay", "remain", "hold", "keep"):
    return words <= lexicon.POSE_WORDS and (verb in ("stay", "remain") or bool(words & lexicon.POSE_NOUNS))
  return verb == "do" and words in ({"not", "move"}, {"nothing"})


def hold(who: str) -> Action:
  """Keeping the pose that the action before ends in."""
  return Action(f"{who} {HOLD}", HOLD, "legs", verb="stand", subject=who)


def holding(segment):
  """The segments of an action with a duration: a raised hand or a low body is kept so long."""
  action = segment.action
  if segment.seconds is None or segment.simultaneous or action.times > 1 or not (
      action.verb in ("raise", "lift") and action.part == "arms" or action.verb in lexicon.LOW):
    return [segment]
  return [segment._replace(seconds=None), Segment(hold(action.subject), (), segment.seconds)]


def with_poses(segments, who):
  """The segments, in which a pause or an action of arms and head keeps the low pose before it.

  With no pose before it a hold is a pause, but for "stays seated", which is an action then.
  """
  posed, low = [], False
  for segment in map(_without_beside, _without_repeated_pauses(segments)):
    action, before = segment.action, posed[-1] if posed else None
    if action.words == HOLD and before is None and lexicon.LOW_POSES & set(action.prompt.split()):
      action = action._replace(words=action.prompt.removeprefix(who + " "))
    elif action.words == HOLD and before is None:
      action = action._replace(prompt=f"{who} {PAUSE}", words=PAUSE, reworded=True)
    elif action.words == PAUSE and (low or before and before.hold_pose and not segment.simultaneous):
      action = action._replace(prompt=f"{who} {HOLD}", words=HOLD)
    elif low and all(map(_stays_low, (action, *segment.simultaneous))):
      segment = segment._replace(simultaneous=(action, *segment.simultaneous))
      action = hold(who)
    posed.append(segment._replace(action=action))
    low = action.verb in lexicon.LOW or low and posed[-1].hold_pose
  return tuple(posed)


def _without_beside(segment):
  """The segment without pauses and holds beside its action: "steps back while holding still" steps back."""
  acting = tuple(action for action in segment.simultaneous if action.words not in (PAUSE, HOLD))
  return segment._replace(simultaneous=acting)


def _stays_low(action):
  return actions.stays_low(action.verb, action.part, lower(action.words.split()))


def _without_repeated_pauses(segments):
  """The segments, of which a pause without a duration after another pause is left out: "stops and stands still"."""
  return [segment for segment, before in zip(segments, (None, *segments))
          if before is None or not (segment.is_pause and before.is_pause and segment.seconds is None)]
