"""Records of what each step did to a motion, as plain JSON values: the rows of `motion.meta["steps"]`.

A record has "step" and "did", a description. If joints changed, it has "frames" [[first, past], ...], "cm", the largest
distance that a joint moved, and "degrees", the largest turn of the trunk or of the line through the hips. "num_frames"
[before, after] is there if the length changed, "score" [before, after] if the step scores: violation scores, 0 if the
prompt is met.
"""
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from motion_jax.motion.filling import runs_of
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Num

Record = dict[str, Any]
MOVED = 1e-4  # metres: a frame counts as changed if a joint moves farther
_STEPS = "steps"


def change_between(before: Num[np.ndarray, "t j 3"], after: Num[np.ndarray, "n j 3"], skeleton: Skeleton = HUMANML3D,
                   start: int = 0) -> Record:
  """Change {frames, cm, degrees, num_frames} between two versions of a motion, in their common frames; {} for none.

  start: the frame of the whole motion at which these joints begin.
  """
  count = min(len(before), len(after))
  length = {} if len(before) == len(after) else {"num_frames": [len(before), len(after)]}
  old, new = (np.asarray(joints[:count], np.float64) for joints in (before, after))
  away = np.linalg.norm(new - old, axis=-1).max(1) * skeleton.unit
  if not (away > MOVED).any():
    return length
  (right, left), spine = (chain[1] for chain in skeleton.chains[:2]), skeleton.chains[2]
  turned = max(_largest_angle(*(joints[:, above] - joints[:, below] for joints in (old, new)))
               for below, above in ((right, left), (spine[0], spine[-2])))
  frames = [[start + first, start + past] for first, past in runs_of(away > MOVED)]
  return {"frames": frames, "cm": round(100 * float(away.max()), 1), "degrees": round(turned, 1)} | length


def _largest_angle(a, b):
  """Largest angle between rows of a and b (T, 3), degrees."""
  angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))
  return float(np.degrees(angles.max()))


def record(step: str, did: str, before: Num[np.ndarray, "t j 3"] | None = None,
           after: Num[np.ndarray, "n j 3"] | None = None, skeleton: Skeleton = HUMANML3D,
           score: Sequence[float] | None = None, start: int = 0) -> Record:
  """The record of a step, with the change between joints before and after and with two scores, if these are given."""
  change = {} if before is None or after is None else change_between(before, after, skeleton, start)
  return {"step": step, "did": did} | change | (
      {"score": [round(float(value), 4) for value in score]} if score is not None else {})


def added(meta: Mapping[str, Any], *records: Record) -> dict[str, Any]:
  """A motion's meta with records appended."""
  return {**meta, _STEPS: [*meta.get(_STEPS, ()), *records]}


def largest(records: Iterable[Record]) -> Record:
  """One record for a step that was applied to several parts of a motion, with the largest change of all."""
  rows = list(records)
  return {key: rows[0][key] for key in ("step", "did")} | {
      key: max(row[key] for row in rows if key in row) for key in ("cm", "degrees") if any(key in row for row in rows)}


def lines(meta: Mapping[str, Any]) -> list[str]:
  """The records of a motion's meta, one line each; malformed records of foreign files are skipped or shortened.

  "pose: hands brought to their places, frames 12 to 58, up to 31.2 cm and 4 degrees".
  """
  rows = meta.get(_STEPS)
  return [line for row in (rows if isinstance(rows, list | tuple) else ())
          if isinstance(row, Mapping) and (line := _line(row))]


def _line(row):
  if not all(isinstance(row.get(key), str) for key in ("step", "did")):
    return ""
  try:
    return ", ".join([f"{row['step']}: {row['did']}", *_changed(row)])
  except (TypeError, ValueError, IndexError, KeyError):
    return f"{row['step']}: {row['did']}"


def _changed(row):
  if runs := row.get("frames"):
    yield f"frames {runs[0][0]} to {runs[-1][1] - 1}"
  by = [f"{row['cm']:g} cm"] if "cm" in row else []
  by += [f"{row['degrees']:.0f} degrees"] if row.get("degrees", 0) >= 1 else []
  if by:
    yield f"up to {' and '.join(by)}"
  if "num_frames" in row:
    yield "{:d} to {:d} frames long".format(*row["num_frames"])
  if "score" in row:
    yield "score {:g} to {:g}".format(*row["score"])
