from . import (
  accumulate,
  control_scores,
  long_horizon,
  physics,
  protocol,
  scores,
  timeline_scores,
  two_sample,
)
from .physics import (
  area_under_jerk,
  bone_drift,
  floating,
  jerk,
  peak_jerk,
  penetration,
  planted_speed,
  skating_ratio,
)
from .protocol import Protocol
from .scores import (
  Moments,
  clip_score,
  diversity,
  fid,
  frechet_distance,
  matching_score,
  moments,
  mpjpe,
  multimodality,
  r_precision,
  retrieval,
)

__all__ = ["Moments", "Protocol", "accumulate", "area_under_jerk", "bone_drift", "clip_score", "control_scores",
           "diversity", "fid", "floating", "frechet_distance", "jerk", "long_horizon", "matching_score", "moments",
           "mpjpe", "multimodality", "peak_jerk", "penetration", "physics", "planted_speed", "protocol", "r_precision",
           "retrieval", "scores", "skating_ratio", "timeline_scores", "two_sample"]
