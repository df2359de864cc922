"""Reroute the steps of a sampled motion whose path nearly meets its requirements.

Steps in place or to a side are moved there, a way back is turned to its goal, and a walk in a circle, a figure of
eight, a zigzag or around a corner is bent to that shape. Each step moves as a whole, which keeps standing feet in place
(`motion.root_paths.along`).
"""
import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax.motion.root_paths import along, bent, course, turned
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.language.path_shapes import PACES
from motion_jax_studio.language.requirements import Requirement

_ASIDE = 0.35   # metres per second to a side
_TURNS = 0.35   # seconds, sigma that removes the sway of the pelvis from its heading
_FACES = 0.8    # radians, range of the heading of a body that steps in place or to a side
_MISSES, _STRIDES = 1.2, 1.5  # largest error of a way back in radians, and as a factor of its length
# Least metres of a path that can be bent to a shape, and the degrees of its course.
_SHORTEST = {"circle": 4.0, "figure-eight": 7.0, "u-turn": 2.5, "curve": 1.6, "zigzag": 3.0, "turn": 1.6}
_DEGREES = {"circle": 340.0, "figure-eight": 360.0, "u-turn": 180.0, "curve": 100.0, "turn": 90.0}
_CORNER = 0.8   # metres, length of a turn during a walk
_LEGS, _SWERVE = 5, 60.0  # straight parts of a zigzag, and degrees of each from its axis


def stepping(joints, fps, requirements, skeleton):
  """Move steps in place, or to a side, as required, if the body went elsewhere."""
  by_kind = {requirement.kind: requirement for requirement in requirements}
  pairs = (("aside", "sideways"), ("stays", "treads"))  # "walks to the left" is no side step
  wanted = next(([by_kind[kind] for kind in pair] for pair in pairs if set(pair) <= by_kind.keys()), [])
  if not wanted:
    return joints
  facing = gaussian_filter1d(np.unwrap(Body(joints, fps).heading), _TURNS * fps, mode="nearest")
  if np.ptp(facing) < _FACES and not violation_score(joints, wanted, fps):
    return joints
  path, _ = course(joints, fps)
  goal = path[0] + _ASIDE / fps * np.arange(len(joints))[:, None] * towards(wanted[0].side, facing[0])
  moved = along(joints, facing[0] - facing, path, goal, skeleton, fps)
  stepped = [*wanted, Requirement("treads", "", 1, False)]
  return joints if violation_score(moved, stepped, fps) else moved.astype(joints.dtype)


def returning(joints, fps, requirements, skeleton):
  """Lead a required way back to the start of the motion, if it nearly gets there: from the farthest point on, the path
  is turned and the steps become longer or shorter."""
  wanted = [requirement for requirement in requirements if requirement.kind == "return"]
  if not wanted or not violation_score(joints, wanted, fps):
    return joints
  path, _ = course(joints, fps)
  farthest = int(np.linalg.norm(path - path[0], axis=-1).argmax())
  (angle, length), (wanted_angle, wanted_length) = (
      (np.arctan2(*offset), float(np.linalg.norm(offset)))
      for offset in (end - path[farthest] for end in (path[-1], path[0])))
  angle = np.angle(np.exp(1j * (wanted_angle - angle)))
  if abs(angle) > _MISSES or not 1 / _STRIDES < length / max(wanted_length, 1e-6) < _STRIDES:
    return joints
  turn = angle * np.clip(((np.arange(len(joints)) - farthest) / fps + 0.5), 0, 1)
  back = turned(path[farthest:] - path[farthest], angle) * (wanted_length / length)
  goal = np.concatenate([path[:farthest], path[farthest] + back])
  moved = along(joints, turn, path, goal, skeleton, fps)
  return joints if violation_score(moved, wanted, fps) else moved.astype(joints.dtype)


def shaped(joints, fps, requirements, skeleton, one_action):
  """Bend a walk to the required shape, or to a turn during the walk, if it has another one.

  one_action: walk and turn were sampled as one action; a turn before or after a walk is not corrected here.
  """
  wanted = [requirement for requirement in requirements
            if requirement.kind in _SHORTEST and (one_action or requirement.kind != "turn")]
  if len(wanted) != 1 or not violation_score(joints, wanted, fps) or wanted[0].kind == "turn" and (
      wanted[0].degrees != (40, 140) or not any(requirement.kind in {*PACES, "run"} for requirement in requirements)):
    return joints
  path, distance = course(joints, fps)
  if distance[-1] < _SHORTEST[wanted[0].kind]:
    return joints
  steps = np.gradient(path, axis=0)
  heading = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
  # Resampled by distance, for the course has no direction while the body stands.
  heading_at = lambda metres: np.interp(metres, np.linspace(0, distance[-1], 200), gaussian_filter1d(
      np.interp(np.linspace(0, distance[-1], 200), distance, heading), 6, mode="nearest"))
  side = wanted[0].side or ("left" if heading_at(distance[-1]) >= heading_at(0.0) else "right")
  sign = 1 if side == "left" else -1
  wanted_heading = lambda metres: sign * np.radians(_course(wanted[0].kind, metres, distance[-1]))
  moved = bent(joints, lambda metres: wanted_heading(metres) - heading_at(metres) + heading_at(0.0), skeleton, fps)
  return joints if violation_score(moved, requirements, fps) >= violation_score(joints, requirements, fps) else (
      moved.astype(joints.dtype))


def _course(kind, metres, length):
  """Degrees between the first direction and that after `metres` of a shape of this length."""
  if kind == "zigzag":
    return _SWERVE * np.sin(np.pi * _LEGS * metres / length)
  if kind == "turn":
    return _DEGREES[kind] * 0.5 * (1 + np.tanh((metres - length / 2) / (_CORNER / 2)))
  if kind == "figure-eight":
    return _DEGREES[kind] * (1 - np.abs(2 * metres / length - 1))
  return _DEGREES[kind] * metres / length


def towards(side, heading):
  """x and z (2,) of the direction to a side of where a body faces; 0 without a side."""
  return {"left": 1.0, "right": -1.0}.get(side, 0.0) * np.array([np.cos(heading), -np.sin(heading)])
