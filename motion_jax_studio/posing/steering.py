"""Successive walks of a plan, each to a side: their paths are turned there if they lead elsewhere."""
from collections.abc import Sequence

import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax.models.results import Motion
from motion_jax.motion.root_paths import bent, course
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import smoothstep
from motion_jax.shapes import Float
from motion_jax_studio.language import Plan, Segment
from motion_jax_studio.posing.spans import bounds_of

_TURN, _ENOUGH = 75.0, (30.0, 150.0)  # degrees to a side: of a corrected walk, and the range that needs no correction
_FAR, _CORNER = 0.5, 0.8  # metres: least distance of a walk, and length of the turn


def with_steering(motion: Motion, plan: Plan) -> Float[np.ndarray, "t j 3"]:
  """Joints of a motion with each walk of its plan to a side turned there; its own joints if all walks are right."""
  segments = plan.read_segments
  courses = [segment.action.slots.course for segment in segments]
  walks = [(number, side) for number, side in enumerate(courses) if side is not None]
  if len(walks) < 2 or not any(side for _, side in walks):
    return motion.joints
  path, distance = course(motion.joints, motion.fps)
  turns = _turns(segments, walks, bounds_of(motion, segments), path, Body(motion.joints, motion.fps).heading[0])
  if not turns:
    return motion.joints
  angle = lambda metres: sum(turn * smoothstep((metres - distance[frame]) / _CORNER) for frame, turn in turns)
  return bent(motion.joints, angle, HUMANML3D, motion.fps).astype(motion.joints.dtype)


def _turns(segments: Sequence[Segment], walks, bounds, path, heading):
  """[(frame, radians to the left)]: the path is turned from this frame on."""
  turns, turned, before = [], 0.0, float(heading)
  for number, side in walks:
    first, past = bounds[number]
    offset = path[min(past, len(path)) - 1] - path[first]
    if np.linalg.norm(offset) < _FAR:
      continue
    backward = segments[number].action.slots.is_backward
    direction = float(np.arctan2(*offset)) + turned
    if side:
      # In a walk backward, the left of the body is the right of the path.
      sign = (1 if side == "left" else -1) * (-1 if backward else 1)
      if not turns and number == walks[0][0] and backward:
        before += np.pi
      change = np.degrees(np.angle(np.exp(1j * (direction - before)))) * sign
      if not _ENOUGH[0] <= change <= _ENOUGH[1]:
        turn = float(np.angle(np.exp(1j * (before + sign * np.radians(_TURN) - direction))))
        turns.append((first, turn))
        turned, direction = turned + turn, direction + turn
    before = direction
  return turns
