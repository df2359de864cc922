"""Small corrections of a sampled motion that nearly meets its requirements: a body that sits down last stays seated,
steps in place and steps and jumps to a side are taken there, a way back leads back, and feet do not float."""
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax.models.results import Motion, features_of
from motion_jax.motion.pinned_feet import pin_feet
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.root_paths import along, course, turned
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_studio.checks.violations import violation_score
from motion_studio.language.requirements import Requirement
from motion_studio.planning.pauses import held_frame, insert_pause

_FLOATS = 0.08  # metres over the floor below which feet that never come lower count as standing
_ASIDE = 0.35   # metres a second to a side
_TURNS = 0.35   # seconds, sigma of what is no turn but a sway of the pelvis
_JUMPS, _IN_THE_AIR = 0.5, 0.05  # metres of a jump to a side, and of the lower foot over the floor in it
_PUSHES = 0.08  # seconds, sigma of the push from the ground
_FACES = 0.8    # radians by which a body that steps in place or to a side may turn away
_MISSES, _STRIDES = 1.2, 1.5  # radians and factor by which a way back may miss the beginning
_HANGS = re.compile(r"\b(?:hang|dangl|bars?\b|swings on|rid(?:es|ing)|swim|fl(?:ies|y|ying)\b)", re.IGNORECASE)


def corrected(model: Any, motion: Motion, requirements: Sequence[Requirement]) -> Motion:
  """The motion with the corrections it needs; the same object where it needs none."""
  skeleton = model.stats.layout.skeleton
  joints = _kept_seated(motion, requirements, skeleton)
  for correct in (_stepping, _jumping, _returning):
    joints = correct(joints, motion.fps, requirements, skeleton)
  height = float(floor_height(joints, skeleton))
  if height > _FLOATS and not _HANGS.search(motion.captions[0].text if motion.captions else ""):
    lowest = joints[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min()
    joints = joints - np.array([0, lowest, 0], joints.dtype)
  if joints is motion.joints:
    return motion
  return motion.replace(joints=joints, features=features_of(model, joints))


def _kept_seated(motion, requirements, skeleton):
  """Joints that hold the seated pose where sitting comes last and the body gets up again."""
  seated = [one for one in requirements if one.kind == "seated"]
  if not seated or not violation_score(motion.joints, seated, motion.fps):
    return motion.joints
  first = round(motion.captions[-1].start * motion.fps) if motion.captions else 0
  at = held_frame(motion.joints, first, motion.num_frames, "low", (), skeleton)
  held, _, _ = insert_pause(motion.joints, at, motion.num_frames - at, skeleton, ends=True, exact=True)
  held = held[:motion.num_frames]
  return motion.joints if violation_score(held, seated, motion.fps) else held


def _stepping(joints, fps, requirements, skeleton):
  """Joints whose steps are taken on one spot or to a side, as the requirements say, where the body went another way.

  The steps are those of the motion; each is moved as a whole, so that standing feet stand (`motion.root_paths.along`).
  """
  own = {one.kind: one for one in requirements}
  pairs = (("aside", "sideways"), ("stays", "treads"))  # "walks to the left" is no side step
  wanted = next(([own[kind] for kind in pair] for pair in pairs if set(pair) <= own.keys()), [])
  if not wanted:
    return joints
  facing = gaussian_filter1d(np.unwrap(Body(joints, fps).heading), _TURNS * fps, mode="nearest")
  if np.ptp(facing) < _FACES and not violation_score(joints, wanted, fps):
    return joints
  path, _ = course(joints, fps)
  goal = path[0] + _ASIDE / fps * np.arange(len(joints))[:, None] * _to(wanted[0].side, facing[0])
  moved = along(joints, facing[0] - facing, path, goal, skeleton, fps)
  stepped = [*wanted, Requirement("treads", "", 1, False)]
  return joints if violation_score(moved, stepped, fps) else moved.astype(joints.dtype)


def _jumping(joints, fps, requirements, skeleton):
  """Joints whose jumps go to a side, as the requirements say, where they did not: each flight leads there.

  The feet are moved in the air only, the rest of the body begins with the push from the ground.
  """
  own = {one.kind: one for one in requirements}
  wanted = [own[kind] for kind in ("aside", "jump", "hop") if kind in own]
  if len(wanted) < 2 or wanted[0].kind != "aside" or not violation_score(joints, wanted, fps):
    return joints
  body, flown = Body(joints, fps), np.zeros(len(joints))
  for first, past in body.spans(body.air > _IN_THE_AIR, least=0.1):
    flown[first:past] += _JUMPS / (past - first)
  way = np.zeros((len(joints), 1, 3))
  way[..., [0, 2]] = _to(wanted[0].side, body.heading[0])
  feet = joints + np.cumsum(flown)[:, None, None] * way
  moved = joints + np.cumsum(gaussian_filter1d(flown, _PUSHES * fps, mode="nearest"))[:, None, None] * way
  pairs = [feet[:, [left, right]] for left, right in zip(skeleton.left_feet, skeleton.right_feet)]
  moved = pin_feet(moved, *pairs, skeleton)
  return joints if violation_score(moved, wanted, fps) else moved.astype(joints.dtype)


def _returning(joints, fps, requirements, skeleton):
  """Joints whose way back leads to the beginning, as the requirements say, where it nearly did: from the farthest place
  on the course is turned there, and its steps become longer or shorter."""
  wanted = [one for one in requirements if one.kind == "return"]
  if not wanted or not violation_score(joints, wanted, fps):
    return joints
  path, _ = course(joints, fps)
  farthest = int(np.linalg.norm(path - path[0], axis=-1).argmax())
  (goes, length), (should, wants) = (
      (np.arctan2(*way), float(np.linalg.norm(way))) for way in (end - path[farthest] for end in (path[-1], path[0])))
  angle = np.angle(np.exp(1j * (should - goes)))
  if abs(angle) > _MISSES or not 1 / _STRIDES < length / max(wants, 1e-6) < _STRIDES:
    return joints
  turn = angle * np.clip(((np.arange(len(joints)) - farthest) / fps + 0.5), 0, 1)
  back = turned(path[farthest:] - path[farthest], angle) * (wants / length)
  goal = np.concatenate([path[:farthest], path[farthest] + back])
  moved = along(joints, turn, path, goal, skeleton, fps)
  return joints if violation_score(moved, wanted, fps) else moved.astype(joints.dtype)


def _to(side, heading):
  """x and z (2,) of the direction to a side of where a body faces; 0 without a side."""
  return {"left": 1.0, "right": -1.0}.get(side, 0.0) * np.array([np.cos(heading), -np.sin(heading)])
