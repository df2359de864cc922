"""One pass of a network guided by constraints, which are compiled to a signal; motions are placed where they begin."""
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax

from motion_jax.control import signal as signals
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.constraints import Constraint
from motion_jax.control.signal import ControlSignal
from motion_jax.models.results import Motions, gathered
from motion_jax.utils.errors import InputError

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel


def sample(model: "TextToMotionModel", prompts: Sequence[str], frames: Sequence[int], keys: jax.Array,
           seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any],
           constraints: Sequence[Sequence[Constraint] | ControlSignal]) -> Motions:
  """Motions of prompts, each guided by its constraints (or signal (1, T)), and placed where these begin.

  Targets that are relative to the body are left out: where the body is, is known only afterwards.
  """
  if not model.takes_control:
    raise InputError(f"got control for {model.id}, which samples by prompts alone; sample without it and bring the "
                     "motion to the constraints by motion_jax.control.project")
  world = [one.slice_frames(0, count) if isinstance(one, ControlSignal) else compile(one, count, model.fps)
           for one, count in zip(constraints, frames)]
  world = [clip_to_feasible(one, model.fps) for one in world]
  places = [signals.placement(one) for one in world]
  rows = [signals.to_model_frame(one, place).slice_frames(0, max(frames)) for one, place in zip(world, places)]
  made = model.sample(prompts, frames, keys, seeds, cleanup, sampling, signals.stack(rows))
  return gathered([motion.replace(joints=signals.to_world_frame(motion.joints, place))
                   for motion, place in zip(made, places)])
