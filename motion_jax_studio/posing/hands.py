"""Hands are brought to where a plan has them, in a sampled motion that has them elsewhere."""
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

_NEAR, _MOSTLY = 0.15, 0.4  # metres from its place at which a hand is there, and the share of the time that it needs
_OVERLAP = 1.8  # times the seconds between two places of a gesture that flows: a hand is on its way to both
_LOWERED = 1.0  # seconds in which hands come down that are up when a motion begins


def with_hands(motion: Motion, plan: Plan) -> Float[np.ndarray, "t j 3"]:
  """Joints of the motion of a plan with hands where its words have them; its own where they are there.

  A hand is brought in the time of its action, kept to the end of it and of a pause after it, or until a later action
  brings it elsewhere.
  """
  segments, joints = plan.read_segments, motion.joints
  places = places_of(segments)
  if not any(places):
    return joints
  bounds = bounds_of(motion, segments)
  for number, own in enumerate(places):
    for at, place in own.items():
      if not place.place and at == 0:
        continue  # the network knows this gesture, and has made it
      if place.place == "down" and number == 0:  # hands that are lowered first of all have been up
        weight = 1 - smoothstep(np.arange(len(joints)) / (_LOWERED * motion.fps))
        joints = bring_hands(joints, "front", place.sides, weight)
      joints = _brought(joints, place, bounds[number][0], _until(segments, places, bounds, number, place), motion.fps)
  return joints


def _until(segments, places, bounds, number, place):
  """The frame to which hands keep a place: that of the next place of theirs, if the arms do nothing before it; else
  they keep it in the action itself and in a pause after it."""
  past, rests = bounds[number][1], True
  for later in range(number + 1, len(segments)):
    if any(not set(place.sides).isdisjoint(other.sides) for other in places[later].values()):
      return bounds[later][0]
    if any(one.part == "arms" for one in segments[later].actions):
      break
    rests = rests and segments[later].is_pause
    past = bounds[later][1] if rests else past
  return past


def _brought(joints, place: HandPlace, first, past, fps):
  """Joints with the hands of a place that are not there in frames first to past, or that make a gesture in them."""
  if past <= first:
    return joints
  sides = [side for side in place.sides if not place.place or (
      distance_to_place(joints[first:past], place.place, side) < _NEAR).mean() < _MOSTLY]
  if not sides:
    return joints
  if not place.gesture:
    return bring_hands(joints, place.place, sides, rising(len(joints), first, past, fps, place.at_once))
  frames, start, posed = np.arange(len(joints)), float(first), joints
  for name, seconds in itertools.cycle(place.gesture) if place.rhythm else place.gesture:
    if start >= past:
      break
    now = min(int(start), len(joints) - 1)
    weight = smoothstep((frames[now:] - start) / ((_OVERLAP if place.flows else 1.0) * seconds * fps))
    posed = np.concatenate([posed[:now], bring_hands(posed[now:], name, sides, weight)])
    start += seconds * fps
  return put_on(joints, posed, "arms", sides, rising(len(joints), 0, past, fps, True), HUMANML3D)
