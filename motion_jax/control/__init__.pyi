from .constraints import (
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
from .files import from_json, load, save, to_json
from .paths import circle, corner, figure_of_eight, slalom, stop_and_go
from .signal import ControlSignal
from .spans import project_frames

__all__ = ["Constraint", "ControlSignal", "EffectorTarget", "EndPose", "InPlace", "KeepParts", "Keyframe", "Loop",
           "RootPath", "StartPose", "circle", "corner", "figure_of_eight", "from_json", "load", "project_frames",
           "save", "slalom", "stop_and_go", "to_json"]
