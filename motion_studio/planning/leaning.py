"""The trunk leans where a plan says so, in a sampled motion in which it does not."""
from typing import Any

import numpy as np

from motion_jax.models.results import Motion, features_of
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_studio.language import Plan
from motion_studio.language.leaning import Lean, lean_of
from motion_studio.planning.spans import bounds_of, rising, segments_of

_DEGREES = {"aside": 20.0, "ahead": 30.0, "back": 15.0}  # of a lean that is made
_CYCLE, _STEADY = 2.5, 0.2  # seconds of swaying there and back; and sigma of a lean, without its tremor


def with_lean(model: Any, motion: Motion, plan: Plan) -> Motion:
  """The motion of a plan with a trunk that leans where its words say so; the same object where it does."""
  segments, joints = segments_of(plan), motion.joints
  for segment, (first, past) in zip(segments, bounds_of(motion, segments)):
    for action in (segment.action, *segment.simultaneous):
      found = lean_of(action)
      if found:
        joints = _leaning(joints, found, first, past, motion.fps)
  return motion if joints is motion.joints else motion.replace(joints=joints, features=features_of(model, joints))


def _leaning(joints, found: Lean, first, past, fps):
  """Joints that lean by what they lack to it, or sway."""
  left, ahead = found.way
  degrees = _DEGREES["aside" if left else "ahead" if ahead > 0 else "back"]
  wanted = degrees * rising(len(joints), first, past, fps)
  if found.sways:
    wanted = wanted * np.sin(2 * np.pi * (np.arange(len(joints)) - first) / (_CYCLE * fps))
  lacks = wanted - gaussian_filter1d(leans(joints, left, ahead), _STEADY * fps, mode="nearest")
  lacks = np.where(wanted == 0, 0.0, lacks if found.sways else np.clip(lacks, 0.0, wanted))
  return lean(joints, left, ahead, gaussian_filter1d(lacks, _STEADY * fps, mode="nearest")) if lacks.any() else joints
