"""Multi-prompt motions with constraints, and reports of constraints for the page (docs/control.md)."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.control import finishing
from motion_jax.control import signal as signals
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.constraints import Constraint
from motion_jax.data.clip import Clip
from motion_jax.export import scene
from motion_jax.models.results import Motion, captions_in_a_row
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_studio import controlled
from motion_studio.server.multi_prompt import MultiPromptCache


def made(stories: MultiPromptCache, model: Any, segments: Sequence[tuple[str, int]], seed: int, cleanup: bool,
         sampling: dict[str, Any], control: Sequence[Constraint]) -> tuple[Motion, int]:
  """(motion, frames that were reused) of (prompt, frames) rows under constraints.

  cleanup: whether constraints are met exactly.
  """
  if model.stats.layout.skeleton is not HUMANML3D:
    raise InputError(f"{model.id} moves the skeleton {model.stats.layout.skeleton.name!r}; control knows the 22 joints "
                     f"of {HUMANML3D.name}")
  control, (prompt, last) = list(control), segments[-1]
  longer = finishing.spare(model.fps) if controlled.finds_its_cycle(control) else 0
  rows = [*segments[:-1], (prompt, last + longer)]
  count = sum(frames for _, frames in segments)
  signal = compile(control, count, model.fps)
  motion, place, reused = _guided(stories, model, rows, seed, cleanup, sampling, signal)
  # Poses and targets relative to the body: its place is known now.
  again = compile(control, count, model.fps, signals.to_world_frame(motion.joints[:count], place))
  if (np.asarray(again.given) != np.asarray(signal.given)).any():
    motion, place, reused = _guided(stories, model, rows, seed, cleanup, sampling, again)
  motion = controlled.done(model, motion, control, place, count, cleanup)
  ends = np.minimum(np.cumsum([frames for _, frames in segments]), motion.num_frames).tolist()
  return motion.replace(captions=captions_in_a_row([prompt for prompt, _ in segments], ends, model.fps)), reused


def _guided(stories, model, rows, seed, cleanup, sampling, signal):
  """(motion in the model's frame, its placement, frames that were reused) of a signal (1, T) in the world."""
  signal = clip_to_feasible(signal, model.fps, warn=False)
  place = signals.placement(signal)
  motion, reused, _ = stories.make(model, rows, seed, cleanup, sampling, hold=signals.to_model_frame(signal, place))
  return motion, place, reused


def report(control: Sequence[Constraint], motion: Clip) -> dict[str, Any]:
  """Constraints as they apply to a motion: {targets: [[frame, x, y, z]], poses: [{frame, joints}], off: {mean, worst,
  frame, joint}}. `off` is the distance in millimetres; it is missing if no constraint has a place."""
  signal = compile(control, motion.num_frames, motion.fps, motion.joints)
  parts, off = scene.parts_of(signal), scene.distance(signal, motion)
  return {"targets": [[frame, *np.round(place, 4).tolist()] for frame, _, place in parts.targets],
          "poses": [{"frame": frame, "joints": np.round(joints, 4).tolist()} for frame, joints in parts.poses]
          } | ({"off": off} if off else {})
