"""Standing still as the base motion of actions that are not sampled, because the pose step adds them."""
from collections.abc import Callable

from motion_jax_studio.language import Plan
from motion_jax_studio.language.actions import still
from motion_jax_studio.language.hand_places import postures_of


def standing(plan: Plan, knows: Callable[[str], bool], can: Callable[[str], bool]) -> Plan:
  """The plan with standing still as the base of each action that is only a lean, a hand pose or a gesture.

  knows(prompt): whether it is a training caption, which is sampled unless it is a lean; can(prompt): whether the model
  can sample this gesture.
  """
  segments = plan.read_segments
  prompt = lambda at: segments[at[0]].actions[at[1]].prompt
  stands = {at for at, place in postures_of(segments).items() if place is None or not (
      knows(prompt(at)) or not place.place and can(prompt(at)))}
  changed = tuple(_standing(segment) if (at, 0) in stands else segment for at, segment in enumerate(segments))
  return plan if changed == segments else plan.with_segments(changed)


def _standing(segment):
  """The segment with standing still as its base action, unless another action moves more than arms and head."""
  who = segment.action.subject or "a person"
  if any(action.part not in ("arms", "head") for action in segment.simultaneous):
    return segment
  return segment._replace(action=still(who),
                          simultaneous=segment.actions)
