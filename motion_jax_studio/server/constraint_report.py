"""Multi-prompt motions with constraints, and reports of constraints for the page (docs/control.md)."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.control.compiling import compile
from motion_jax.control.constraints import Constraint
from motion_jax.control.keys import without_slack
from motion_jax.data.clip import Clip
from motion_jax.export import scene
from motion_jax.models.results import Motion, captions_in_a_row
from motion_jax_studio import constraining
from motion_jax_studio.server.multi_prompt import MultiPromptCache


def made(stories: MultiPromptCache, pipeline: Any, segments: Sequence[tuple[str, int]], seed: int, cleanup: bool,
         sampling: dict[str, Any], control: Sequence[Constraint]) -> tuple[Motion, int]:
  """(motion, frames that were reused) of (prompt, frames) rows that meets constraints; exactly so with cleanup."""
  constraining.check_skeleton(pipeline.model)
  fps, (prompt, last), reused = pipeline.model.fps, segments[-1], 0
  count = sum(frames for _, frames in segments)
  target = constraining.target_of(list(control), count, fps, cleanup)
  rows = [*segments[:-1], (prompt, last + target.frames_to_sample(fps) - count)]

  def sample(signals):
    nonlocal reused
    motion, reused, _ = stories.make(pipeline, rows, seed, cleanup, sampling, hold=signals[0])
    return [motion]

  motion, = constraining.sample_guided([target], fps, sample)
  motion = constraining.constrain(pipeline.model, motion, target, cleanup)
  ends = np.minimum(np.cumsum([frames for _, frames in segments]), motion.num_frames).tolist()
  return motion.replace(captions=captions_in_a_row([prompt for prompt, _ in segments], ends, fps)), reused


def report(control: Sequence[Constraint], motion: Clip) -> dict[str, Any]:
  """Constraints as they apply to a motion: {targets: [[frame, x, y, z]], poses: [{frame, joints}], off: {mean, worst,
  frame, joint}}. `off` is the distance in millimetres, of keys at full strength; it is missing if no constraint has a
  place."""
  known = without_slack([one for one in control if getattr(one, "strength", 1) == 1], motion.joints, motion.fps)
  signal = compile(known, motion.num_frames, motion.fps, motion.joints)
  parts, off = scene.parts_of(signal), scene.distance(signal, motion)
  return {"targets": [[frame, *np.round(place, 4).tolist()] for frame, _, place in parts.targets],
          "poses": [{"frame": frame, "joints": np.round(joints, 4).tolist()} for frame, joints in parts.poses]
          } | ({"off": off} if off else {})
