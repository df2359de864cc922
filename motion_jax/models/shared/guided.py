"""One pass of a network guided by constraints, which are compiled to a signal; motions are placed where they begin."""
from collections.abc import Sequence
from typing import Any

import jax

from motion_jax.control import signal as signals
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.files import constraints_of
from motion_jax.control.signal import ControlSignal
from motion_jax.models.results import Motions, gathered
from motion_jax.utils.errors import InputError


def sample(model: Any, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
           cleanup: bool, sampling: dict[str, Any], control: Any) -> Motions:
  """Motions of prompts, each guided by its constraints (or signal (1, T)), and placed where these begin.

  model: a `TextToMotionModel`; control: see its `generate`. Targets relative to the body are left out, as the body's
  place is known only afterwards.
  """
  if not model.takes_control:
    raise InputError(f"got control for {model.id}, which samples by prompts alone; sample without it and bring the "
                     "motion to the constraints by motion_jax.control.project")
  world = [targets.slice_frames(0, count) if isinstance(targets, ControlSignal) else compile(targets, count, model.fps)
           for targets, count in zip(constraints_of(control, len(prompts)), frames)]
  world = [clip_to_feasible(signal, model.fps) for signal in world]
  places = [signals.placement(signal) for signal in world]
  rows = [signals.to_model_frame(signal, place).slice_frames(0, max(frames)) for signal, place in zip(world, places)]
  motions = model.sample(prompts, frames, keys, seeds, cleanup, sampling, signals.stack(rows))
  return gathered([motion.replace(joints=signals.to_world_frame(motion.joints, place))
                   for motion, place in zip(motions, places)])
