"""Detect rest poses, and sitting down or standing up, in joints (T, 22, 3)."""
import numpy as np

from motion_jax.analysis.signals import JOINT, PAIR, Body
from motion_jax.motion.contacts import velocity
from motion_jax.motion.pinned_feet import stands
from motion_jax.shapes import Bool, Float

_LOW, _HIGH = 0.86, 0.95  # pelvis height relative to standing: upper limit of sitting, lower limit of standing
_LEAST = 0.5              # seconds of sitting
_CHANGE = 2.5             # seconds: longest way down or up


def resting(joints: Float[np.ndarray, "t 22 3"], fps: float = 20.0) -> Bool[np.ndarray, " t"]:
  """Frames (T,) in which a body stands at rest: slow, upright, arms down, feet side by side."""
  slow = np.linalg.norm(velocity(joints, fps, 0.2), axis=-1).max(1) < 0.5
  low = joints[:, PAIR["wrist"], 1].max(1) < joints[:, JOINT["spine3"], 1]
  line = joints[:, JOINT["neck"]] - joints[:, 0]
  upright = line[:, 1] > 0.96 * np.linalg.norm(line, axis=-1)
  feet = joints[:, PAIR["ankle"]]
  near = np.linalg.norm((feet[:, 0] - feet[:, 1])[:, [0, 2]], axis=-1) < 0.4
  return slow & low & upright & near & stands(joints, fps).all(1)


def sittings(joints: Float[np.ndarray, "t 22 3"], fps: float = 20.0) -> list[tuple[str, int, int, int, int]]:
  """Transitions between standing and sitting: ("sit" or "rise", and the first frames of the phase before, of the
  transition, of the phase after, and of whatever follows)."""
  body = Body(np.asarray(joints, np.float64), fps)
  height = body.pelvis / np.percentile(body.pelvis, 95)
  sitting = (height < _LOW) & (body.knees.min(1) < 130) & (body.speed < 0.3) & (body.trunk < 60) & (body.pelvis > 0.3)
  standing = (height > _HIGH) & (body.knees.max(1) > 140)
  transitions = []
  for first, past in body.spans(sitting, least=_LEAST, gap=0.3):
    before, after = np.flatnonzero(standing[:first]), np.flatnonzero(standing[past:]) + past
    if len(before) and first - before[-1] < _CHANGE * fps:
      down = int(before[-1])
      begin = down - int(np.argmin(standing[:down + 1][::-1])) + 1 if not standing[:down + 1].all() else 0
      transitions.append(("sit", begin, down, first, past))
    if len(after) and after[0] - past < _CHANGE * fps:
      up = int(after[0])
      end = up + int(np.argmin(standing[up:])) if not standing[up:].all() else len(joints)
      transitions.append(("rise", first, past, up, end))
  return transitions
