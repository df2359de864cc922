"""The trunk leans where a plan says so, in a sampled motion in which it does not."""
import numpy as np

from motion_jax.models.results import Motion
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Float
from motion_jax_studio.language import Plan
from motion_jax_studio.language.leaning import Lean
from motion_jax_studio.posing.spans import bounds_of, rising

_DEGREES = {"aside": 20.0, "ahead": 30.0, "back": 15.0}  # of a lean that is made
_CYCLE, _STEADY = 2.5, 0.2  # seconds of swaying there and back; and sigma of a lean, without its tremor


def with_lean(motion: Motion, plan: Plan) -> Float[np.ndarray, "t j 3"]:
  """Joints of the motion of a plan with a trunk that leans where its words say so; its own where it does."""
  segments, joints = plan.read_segments, motion.joints
  for segment, (first, past) in zip(segments, bounds_of(motion, segments)):
    if past <= first:
      continue
    for action in (segment.action, *segment.simultaneous):
      found = action.lean
      if found:
        joints = _leaning(joints, found, first, past, motion.fps)
  return joints


def _leaning(joints, found: Lean, first, past, fps):
  """Joints that lean by what they lack to it, or sway."""
  left, ahead = found.way
  degrees = _DEGREES["aside" if left else "ahead" if ahead > 0 else "back"]
  weight = rising(len(joints), first, past, fps)
  own = gaussian_filter1d(leans(joints, left, ahead), _STEADY * fps, mode="nearest")
  if found.sways:
    sway = degrees * np.sin(2 * np.pi * (np.arange(len(joints)) - first) / (_CYCLE * fps))
    lacks = sway - own + np.median(own[first:past])
  else:
    lacks = np.clip(degrees - own, 0.0, degrees)
  return lean(joints, left, ahead, weight * lacks) if (weight * lacks).any() else joints
