"""Hand poses and gestures of a plan, added to a sampled motion whose hands are elsewhere."""
import itertools

import numpy as np

from motion_jax.models.results import Motion
from motion_jax.motion.layering import put_on
from motion_jax.motion.reaching import bring_hands, distance_to_place
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import smoothstep
from motion_jax.shapes import Float
from motion_jax_studio.language import Plan
from motion_jax_studio.language.hand_places import HandPlace, places_of
from motion_jax_studio.posing.spans import bounds_of, rising

_NEAR, _MOSTLY = 0.15, 0.4  # a hand is in place if it is this close (metres) for this share of the time
_OVERLAP = 1.8  # factor on the seconds between the places of a flowing gesture, so that moves to two places overlap
_LOWERED = 1.0  # seconds to lower hands that are raised when a motion begins


def with_hands(motion: Motion, plan: Plan) -> Float[np.ndarray, "t j 3"]:
  """Joints of a motion with the hand poses of its plan; its own joints if the hands are in place.

  A hand reaches its place during its action, and keeps it to the end of the action and of pauses after it, or until a
  later action moves it elsewhere.
  """
  segments, joints = plan.read_segments, motion.joints
  places = places_of(segments)
  if not any(places):
    return joints
  bounds = bounds_of(motion, segments)
  for number, hand_places in enumerate(places):
    for at, place in hand_places.items():
      if not place.place and at == 0:
        continue  # the network knows this gesture and has sampled it
      if place.place == "down" and number == 0:  # hands that are lowered by the first action start raised
        weight = 1 - smoothstep(np.arange(len(joints)) / (_LOWERED * motion.fps))
        joints = bring_hands(joints, "front", place.sides, weight)
      joints = _brought(joints, place, bounds[number][0], _until(segments, places, bounds, number, place), motion.fps)
  return joints


def _until(segments, places, bounds, number, place):
  """Last frame of a hand pose: the start of the next pose of these hands if the arms do nothing before it, else the end
  of the action and of the pauses after it."""
  past, rests = bounds[number][1], True
  for later in range(number + 1, len(segments)):
    if any(not set(place.sides).isdisjoint(other.sides) for other in places[later].values()):
      return bounds[later][0]
    if any(action.part == "arms" for action in segments[later].actions):
      break
    rests = rests and segments[later].is_pause
    past = bounds[later][1] if rests else past
  return past


def _brought(joints, place: HandPlace, first, past, fps):
  """Bring hands to a place, or through a gesture, in frames first to past; hands that are in place stay as they are."""
  if past <= first:
    return joints
  sides = [side for side in place.sides if not place.place or (
      distance_to_place(joints[first:past], place.place, side) < _NEAR).mean() < _MOSTLY]
  if not sides:
    return joints
  if not place.gesture:
    return bring_hands(joints, place.place, sides, rising(len(joints), first, past, fps, place.from_start))
  frames, start, posed = np.arange(len(joints)), float(first), joints
  for name, seconds in itertools.cycle(place.gesture) if place.repeats else place.gesture:
    if start >= past:
      break
    now = min(int(start), len(joints) - 1)
    weight = smoothstep((frames[now:] - start) / ((_OVERLAP if place.is_smooth else 1.0) * seconds * fps))
    posed = np.concatenate([posed[:now], bring_hands(posed[now:], name, sides, weight)])
    start += seconds * fps
  return put_on(joints, posed, "arms", sides, rising(len(joints), 0, past, fps, True), HUMANML3D)
