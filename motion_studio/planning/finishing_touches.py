"""Small corrections of a sampled motion that nearly meets its requirements: a body that sits down last stays seated,
and feet do not float."""
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.models.results import Motion, features_of
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.skeleton import HUMANML3D
from motion_studio.checks.violations import violation_score
from motion_studio.language.requirements import Requirement
from motion_studio.planning.pauses import held_frame, insert_pause

_FLOATS = 0.08  # metres over the floor below which feet that never come lower count as standing
_HANGS = re.compile(r"\b(?:hang|dangl|bars?\b|swings on|rid(?:es|ing)|swim|fl(?:ies|y|ying)\b)", re.IGNORECASE)


def corrected(model: Any, motion: Motion, requirements: Sequence[Requirement]) -> Motion:
  """The motion with the corrections it needs; the same object where it needs none."""
  joints = _kept_seated(motion, requirements, model.stats.layout.skeleton)
  height = float(floor_height(joints, model.stats.layout.skeleton))
  if height > _FLOATS and not _HANGS.search(motion.captions[0].text if motion.captions else ""):
    lowest = joints[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min()
    joints = joints - np.array([0, lowest, 0], joints.dtype)
  if joints is motion.joints:
    return motion
  return motion.replace(joints=joints, features=features_of(model, joints))


def _kept_seated(motion, requirements, skeleton):
  """Joints that hold the seated pose where sitting comes last and the body gets up again."""
  seated = [one for one in requirements if one.kind == "seated"]
  if not seated or not violation_score(motion.joints, seated, motion.fps):
    return motion.joints
  first = round(motion.captions[-1].start * motion.fps) if motion.captions else 0
  at = held_frame(motion.joints, first, motion.num_frames, "low", (), skeleton)
  held, _, _ = insert_pause(motion.joints, at, motion.num_frames - at, skeleton, ends=True, exact=True)
  held = held[:motion.num_frames]
  return motion.joints if violation_score(held, seated, motion.fps) else held
