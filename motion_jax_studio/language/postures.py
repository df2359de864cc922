"""Which actions of a plan are postures: hands in a place, a gesture of the arms, a trunk that leans."""
from collections.abc import Sequence

from motion_jax_studio.language.hand_places import HandPlace, places_of
from motion_jax_studio.language.segments import Action, Segment


def postures_of(segments: Sequence[Segment]) -> list[tuple[Action, HandPlace | None]]:
  """The actions that are no more than a posture, each with where it has hands; None for a lean."""
  hands = [(action, place) for own in places_of(segments) for action, place in own
           if place.alone and (action.part == "arms" or not action.verb or place.flows)]
  leans = [(action, None) for segment in segments for action in (segment.action, *segment.simultaneous)
           if action.lean]
  return [*hands, *leans]
