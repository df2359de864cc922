"""Numbers about motion: scores of embeddings, physics of joints, and the protocols that combine them."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.metrics import (
    accumulate,
    control_scores,
    long_horizon,
    physics,
    protocol,
    scores,
    timeline_scores,
    two_sample,
  )
  from motion_jax.metrics.physics import (
    area_under_jerk,
    bone_drift,
    floating,
    jerk,
    peak_jerk,
    penetration,
    planted_speed,
    skating_ratio,
  )
  from motion_jax.metrics.protocol import Protocol
  from motion_jax.metrics.scores import (
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

__getattr__, __dir__ = lazy.attach(__name__)
