"""Constraints beside the prompt: paths, poses, hand and foot targets, loops, body parts."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.control.constraints import (
    Constraint,
    EffectorTarget,
    EndPose,
    InPlace,
    KeepParts,
    Keyframe,
    Loop,
    RootPath,
    StartPose,
  )
  from motion_jax.control.files import from_json, load, save, to_json
  from motion_jax.control.paths import circle, corner, figure_of_eight, slalom, stop_and_go
  from motion_jax.control.signal import ControlSignal

__all__ = ["Constraint", "ControlSignal", "EffectorTarget", "EndPose", "InPlace", "KeepParts", "Keyframe", "Loop",
           "RootPath", "StartPose", "circle", "corner", "figure_of_eight", "from_json", "load", "save", "slalom",
           "stop_and_go", "to_json"]

__getattr__, __dir__ = lazy.attach(__name__)
