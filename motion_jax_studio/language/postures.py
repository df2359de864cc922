"""Which actions of a plan are postures: hands in a place, a gesture of the arms, a trunk that leans."""
from collections.abc import Sequence

from motion_jax_studio.language.actions import Segment
from motion_jax_studio.language.hand_places import HandPlace, places_of


def postures_of(segments: Sequence[Segment]) -> dict[tuple[int, int], HandPlace | None]:
  """{(segment, action): hand pose} of the actions that are only a posture, by their indices; None stands for a lean."""
  postures = {(at, number): place for at, places in enumerate(places_of(segments)) for number, place in places.items()
              if place.alone and (place.flows or segments[at].actions[number].part == "arms" or not (
                  segments[at].actions[number].verb))}
  return postures | {(at, number): None for at, segment in enumerate(segments)
                     for number, action in enumerate(segment.actions) if action.slots.lean}
