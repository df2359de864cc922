"""The pose step, which needs no network: turns walks to their side, and adds the leans and hand poses of a plan."""
from typing import Any

from motion_jax.models.results import Motion, features_of
from motion_jax.motion.step_records import added, record
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Plan
from motion_jax_studio.posing.hands import with_hands
from motion_jax_studio.posing.leaning import with_lean
from motion_jax_studio.posing.steering import with_steering

_CHANGES = (("walks turned to their side", with_steering), ("trunk leant", with_lean),
            ("hands brought to their places", with_hands))


def posed(model: Any, motion: Motion, plan: Plan | None) -> Motion:
  """The motion with the walking directions, leans and hand poses of its plan, each change recorded; the same object if
  nothing changes."""
  if plan is None or not can_be_checked(model):
    return motion
  joints, records = motion.joints, []
  for did, change in _CHANGES:
    before, joints = joints, change(motion.replace(joints=joints), plan)
    if joints is not before:
      records.append(record("pose", did, before, joints, motion.skeleton))
  return motion if joints is motion.joints else motion.replace(
      joints=joints, features=features_of(model, joints), meta=added(motion.meta, *records))
