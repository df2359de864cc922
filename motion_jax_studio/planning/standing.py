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
  prompt = lambda at: segments[at[0]].actions[at[1]].prompt
  stands = {at for at, place in postures_of(segments).items() if place is None or not (
      knows(prompt(at)) or not place.place and can(prompt(at)))}
  changed = tuple(_standing(segment) if (at, 0) in stands else segment for at, segment in enumerate(segments))
  return plan if changed == segments else plan.with_segments(changed)


def _standing(segment):
  """The segment with a body that stands still below its action; unless another action moves more than arms and head."""
  who = segment.action.subject or "a person"
  if any(one.part not in ("arms", "head") for one in segment.simultaneous):
    return segment
  return segment._replace(action=Action(f"{who} {PAUSE}", PAUSE, "legs", verb="stand", subject=who),
                          simultaneous=segment.actions)
