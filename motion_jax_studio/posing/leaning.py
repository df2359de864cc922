"""Leans of the trunk that a plan contains, added to a sampled motion that lacks them."""
import numpy as np

from motion_jax.models.results import Motion
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Float
from motion_jax_studio.language import Plan
from motion_jax_studio.language.slots import Lean
from motion_jax_studio.posing.spans import bounds_of, rising

_DEGREES = {"aside": 20.0, "ahead": 30.0, "back": 15.0}  # of an added lean
_CYCLE, _STEADY = 2.5, 0.2  # seconds: period of swaying; sigma that smooths the measured lean


def with_lean(motion: Motion, plan: Plan) -> Float[np.ndarray, "t j 3"]:
  """Joints of a motion with the leans of its plan; its own joints if the trunk leans already."""
  segments, joints = plan.read_segments, motion.joints
  for segment, (first, past) in zip(segments, bounds_of(motion, segments)):
    if past <= first:
      continue
    for action in (segment.action, *segment.simultaneous):
      planned_lean = action.slots.lean
      if planned_lean:
        joints = _leaning(joints, planned_lean, first, past, motion.fps)
  return joints


def _leaning(joints, planned_lean: Lean, first, past, fps):
  """Add the missing degrees of a lean, or a sway, in frames first to past."""
  left, ahead = planned_lean.direction
  degrees = _DEGREES["aside" if left else "ahead" if ahead > 0 else "back"]
  weight = rising(len(joints), first, past, fps)
  degrees_now = gaussian_filter1d(leans(joints, left, ahead), _STEADY * fps, mode="nearest")
  if planned_lean.sways:
    sway = degrees * np.sin(2 * np.pi * (np.arange(len(joints)) - first) / (_CYCLE * fps))
    lacks = sway - degrees_now + np.median(degrees_now[first:past])
  else:
    lacks = np.clip(degrees - degrees_now, 0.0, degrees)
  return lean(joints, left, ahead, weight * lacks) if (weight * lacks).any() else joints
