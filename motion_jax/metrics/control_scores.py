"""How well motions follow their spatial constraints: OmniControl's metrics.

Source: neu-vi/OmniControl@76336a6:utils/metrics.py.

Of each motion the distances, in metres, of a controlled joint from where it should be, at the controlled frames.
"""
from collections.abc import Sequence

import numpy as np

from motion_jax.shapes import Num

THRESHOLDS = {"20": 0.2, "50": 0.5}  # metres; papers print those of 0.5
NAMES = (*(f"{kind}_{name}" for kind in ("trajectory", "location") for name in THRESHOLDS), "control_error")


def control_scores(distances: Sequence[Num[np.ndarray, " _"]]) -> dict[str, float]:
  """Of motions with distances (N,) each. trajectory_50: share of motions of which any is over 0.5 m; location_50: share
  of all points that are; control_error: mean of each motion, then of the motions, in metres."""
  if not distances or any(not len(one) for one in distances):
    raise ValueError("got a motion without a controlled frame; leave out motions that have no constraint")
  every = np.concatenate(distances)
  found = {f"trajectory_{name}": float(np.mean([(one > most).any() for one in distances]))
           for name, most in THRESHOLDS.items()}
  found |= {f"location_{name}": float((every > most).mean()) for name, most in THRESHOLDS.items()}
  return found | {"control_error": float(np.mean([one.mean() for one in distances]))}
