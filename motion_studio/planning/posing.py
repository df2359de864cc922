"""What needs no network: walks are turned to their side, hands and trunk brought to where a plan has them."""
from collections.abc import Callable
from typing import Any

from motion_jax.models.results import Motion
from motion_studio.checks.violations import can_be_checked
from motion_studio.language import Action, Plan, Segment
from motion_studio.language.hand_places import hand_place_of, places_of
from motion_studio.language.leaning import lean_of
from motion_studio.language.lexicon import PAUSE
from motion_studio.planning.hands import with_hands
from motion_studio.planning.leaning import with_lean
from motion_studio.planning.spans import segments_of
from motion_studio.planning.steering import with_steering


def posed(model: Any, motion: Motion, plan: Plan | None) -> Motion:
  """The motion of a plan with walks, trunk and hands where its words have them; the same object where they are there.
  """
  if plan is None or not can_be_checked(model):
    return motion
  for change in (with_steering, with_lean, with_hands):
    motion = change(model, motion, plan)
  return motion


def is_posture(model: Any, action: Action) -> bool:
  """Whether an action is no more than a posture, so that `posed` makes it and nothing is sampled for it."""
  place = hand_place_of(action)
  return can_be_checked(model) and bool(action.part == "arms" and place and place.alone or lean_of(action))


def standing(plan: Plan, knows: Callable[[str], bool], can: Callable[[str], bool]) -> Plan:
  """The plan in which a body stands still where it only leans, has its hands brought to a place, or makes a gesture.

  knows: whether a prompt is a training caption, which is sampled; can: whether a model can make a gesture.
  """
  own = {id(action) for placed in places_of(segments_of(plan)) for action, place in placed
         if action.part == "arms" and place.alone and not (
             knows(action.prompt) or not place.place and can(action.prompt))}
  segments = tuple(
      Segment(Action(f"{segment.action.subject} {PAUSE}", PAUSE, "legs", verb="stand", subject=segment.action.subject),
              (segment.action, *segment.simultaneous), segment.seconds)
      if not segment.simultaneous and id(segment.action) in own or lean_of(segment.action) and all(
          one.part in ("arms", "head") for one in segment.simultaneous) else segment
      for segment in segments_of(plan))
  return plan if segments == segments_of(plan) else plan.with_segments(segments)
