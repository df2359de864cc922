"""Standing still below actions that need no sample, because the pose step adds them."""
from collections.abc import Callable

from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.lexicon import PAUSE
from motion_jax_studio.language.postures import postures_of


def standing(plan: Plan, knows: Callable[[str], bool], can: Callable[[str], bool]) -> Plan:
  """The plan in which a body stands still where it only leans, has its hands brought to a place, or makes a gesture.

  knows: whether a prompt is a training caption, which is sampled, unless it leans; can: whether a model can make a
  gesture.
  """
  segments = plan.read_segments
  stands = {id(action) for action, place in postures_of(segments) if place is None or not (
      knows(action.prompt) or not place.place and can(action.prompt))}
  changed = tuple(_standing(segment) if id(segment.action) in stands else segment for segment in segments)
  return plan if changed == segments else plan.with_segments(changed)


def _standing(segment):
  """The segment with a body that stands still below its action; unless another action moves more than arms and head."""
  who = segment.action.subject or "a person"
  if any(one.part not in ("arms", "head") for one in segment.simultaneous):
    return segment
  return segment._replace(action=Action(f"{who} {PAUSE}", PAUSE, "legs", verb="stand", subject=who),
                          simultaneous=(segment.action, *segment.simultaneous))
