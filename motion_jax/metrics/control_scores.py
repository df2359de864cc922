"""OmniControl's metrics of how well motions follow spatial constraints.

Source: neu-vi/OmniControl@76336a6:utils/metrics.py. Input: for each motion the distances, metres, of the controlled
joint from its target, at the controlled frames.
"""
from collections.abc import Sequence

import numpy as np

from motion_jax.shapes import Num

THRESHOLDS = {"20": 0.2, "50": 0.5}  # metres; papers print those of 0.5
NAMES = (*(f"{kind}_{name}" for kind in ("trajectory", "location") for name in THRESHOLDS), "control_error")


def control_scores(distances: Sequence[Num[np.ndarray, " _"]]) -> dict[str, float]:
  """Scores of motions with distances (N,) each. trajectory_50: share of motions with a distance over 0.5 m;
  location_50: share of all points over 0.5 m; control_error: mean over motions of the mean distance, metres."""
  if not distances or any(not len(errors) for errors in distances):
    raise ValueError("got a motion without a controlled frame; leave out motions that have no constraint")
  every = np.concatenate(distances)
  row = {f"trajectory_{name}": float(np.mean([(errors > most).any() for errors in distances]))
           for name, most in THRESHOLDS.items()}
  row |= {f"location_{name}": float((every > most).mean()) for name, most in THRESHOLDS.items()}
  return row | {"control_error": float(np.mean([errors.mean() for errors in distances]))}
