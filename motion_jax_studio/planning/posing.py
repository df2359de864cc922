"""What needs no network: walks are turned to their side, hands and trunk brought to where a plan has them."""
from collections.abc import Callable
from typing import Any

from motion_jax.models.results import Motion, features_of
from motion_jax.motion.step_records import added, record
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.lexicon import PAUSE
from motion_jax_studio.language.postures import postures_of
from motion_jax_studio.planning.hands import with_hands
from motion_jax_studio.planning.leaning import with_lean
from motion_jax_studio.planning.spans import read_segments
from motion_jax_studio.planning.steering import with_steering

_CHANGES = (("walks turned to their side", with_steering), ("trunk leant", with_lean),
            ("hands brought to their places", with_hands))


def posed(model: Any, motion: Motion, plan: Plan | None) -> Motion:
  """The motion of a plan with walks, trunk and hands where its words have them, each change recorded; the same object
  where they are there."""
  if plan is None or not can_be_checked(model):
    return motion
  joints, records = motion.joints, []
  for did, change in _CHANGES:
    before, joints = joints, change(motion.replace(joints=joints), plan)
    if joints is not before:
      records.append(record("pose", did, before, joints, motion.skeleton))
  return motion if joints is motion.joints else motion.replace(
      joints=joints, features=features_of(model, joints), meta=added(motion.meta, *records))


def standing(plan: Plan, knows: Callable[[str], bool], can: Callable[[str], bool]) -> Plan:
  """The plan in which a body stands still where it only leans, has its hands brought to a place, or makes a gesture.

  knows: whether a prompt is a training caption, which is sampled, unless it leans; can: whether a model can make a
  gesture.
  """
  segments = read_segments(plan)
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
