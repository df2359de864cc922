"""Small corrections of a sampled motion that nearly meets its requirements: a body that sits down last stays seated, a
motion of the wrong side is mirrored, steps and jumps are moved to their direction (`rerouting`), and floating feet are
put on the floor."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.analysis.signals import SIDES, Body
from motion_jax.models.results import Motion, features_of
from motion_jax.motion.pinned_feet import pin_feet
from motion_jax.motion.retarget import floor_height, mirror
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.motion.step_records import added, record
from motion_jax_studio.checks.violations import gets_up, violation_score
from motion_jax_studio.language.requirements import Requirement
from motion_jax_studio.language.words import has_phrase, normalize, tokens
from motion_jax_studio.planning.pauses import held_frame, insert_pause
from motion_jax_studio.posing.rerouting import returning, shaped, stepping, towards

_FLOATS = 0.08  # metres; feet whose lowest height is above this float
_JUMPS, _IN_THE_AIR = 0.5, 0.05  # metres: width of a jump to a side; height of the lower foot in flight, at least
_PUSHES = 0.08  # seconds, sigma of the sideways push before and after a flight
_SIDE_WORDS = {"left", "right", "clockwise", "counterclockwise"}
_HANGS = "hang*, dangl*, bar, bars, swings on, rides, riding, swim*, flies, fly, flying"


def corrected(model: Any, motion: Motion, requirements: Sequence[Requirement]) -> Motion:
  """Apply the corrections that the motion needs, each recorded with the violation scores before and after; returns the
  same object if it needs none."""
  joints, records, score = motion.joints, [], None
  for label, correct in _CORRECTIONS:
    before, joints = joints, correct(joints, motion, requirements, model.stats.layout.skeleton)
    if joints is not before:
      old = violation_score(before, requirements, motion.fps) if score is None else score
      score = violation_score(joints, requirements, motion.fps)
      records.append(record("correct", label, before, joints, motion.skeleton, (old, score)))
  return motion if joints is motion.joints else motion.replace(
      joints=joints, features=features_of(model, joints), meta=added(motion.meta, *records))


def _kept_seated(joints, motion, requirements, skeleton):
  """Hold the seated pose if the plan ends seated and the body gets up, even if it sits down again."""
  seated = [requirement for requirement in requirements if requirement.kind == "seated"]
  if not seated:
    return motion.joints
  first = round(motion.captions[-1].start * motion.fps) if motion.captions else 0
  past = first + gets_up(Body(np.asarray(motion.joints[first:], np.float64), motion.fps))
  if past == motion.num_frames and not violation_score(motion.joints, seated, motion.fps):
    return motion.joints
  at = held_frame(motion.joints, first, past, "low", (), skeleton)
  held, _, _ = insert_pause(motion.joints, at, motion.num_frames - at, skeleton, ends=True, exact=True)
  held = held[:motion.num_frames]
  return motion.joints if violation_score(held, seated, motion.fps) else held


def _mirrored(joints, motion, requirements, skeleton):
  """Mirror the motion if only its mirror image meets the requirements, and each side in the captions belongs to one."""
  sided = [requirement for requirement in requirements if requirement.side in SIDES]
  words = [word for caption in motion.captions for word in tokens(caption.text.replace("-", " "))]
  named = [word for word in words if word in _SIDE_WORDS]
  if not sided or len(named) != len(sided) or not violation_score(joints, sided, motion.fps):
    return joints
  other = mirror(joints, skeleton)
  return joints if violation_score(other, requirements, motion.fps) else other


def _jumping(joints, fps, requirements, skeleton):
  """Move jumps to the required side, if they do not go there: each flight leads to it.

  Feet move in the air only; the rest of the body already moves with the push from the ground.
  """
  by_kind = {requirement.kind: requirement for requirement in requirements}
  wanted = [by_kind[kind] for kind in ("aside", "jump", "hop") if kind in by_kind]
  if len(wanted) < 2 or wanted[0].kind != "aside" or not violation_score(joints, wanted, fps):
    return joints
  body, shift = Body(joints, fps), np.zeros(len(joints))
  for first, past in body.spans(body.air > _IN_THE_AIR, least=0.1):
    shift[first:past] += _JUMPS / (past - first)
  direction = np.zeros((len(joints), 1, 3))
  direction[..., [0, 2]] = towards(wanted[0].side, body.heading[0])
  feet = joints + np.cumsum(shift)[:, None, None] * direction
  moved = joints + np.cumsum(gaussian_filter1d(shift, _PUSHES * fps, mode="nearest"))[:, None, None] * direction
  pairs = [feet[:, [left, right]] for left, right in zip(skeleton.left_feet, skeleton.right_feet)]
  moved = pin_feet(moved, *pairs, skeleton)
  return joints if violation_score(moved, wanted, fps) else moved.astype(joints.dtype)


def _on_the_floor(joints, motion, _, skeleton):
  """Lower a motion whose feet never reach the floor, unless the body hangs, rides or swims."""
  height = float(floor_height(joints, skeleton))
  if height <= _FLOATS or motion.captions and has_phrase(normalize(motion.captions[0].text), _HANGS):
    return joints
  lowest = joints[:, list(HUMANML3D.left_feet + HUMANML3D.right_feet), 1].min()
  return joints - np.array([0, lowest, 0], joints.dtype)


def _rerouted(change):
  return lambda joints, motion, requirements, skeleton: change(joints, motion.fps, requirements, skeleton)


def _shaped(joints, motion, requirements, skeleton):
  return shaped(joints, motion.fps, requirements, skeleton, one_action=len(motion.captions) <= 1)


_CORRECTIONS = (
    ("kept seated", _kept_seated), ("left and right exchanged", _mirrored),
    ("steps taken in place or to the side", _rerouted(stepping)), ("jumps moved to the side", _rerouted(_jumping)),
    ("way back turned to the beginning", _rerouted(returning)), ("walk bent to its shape", _shaped),
    ("put on the floor", _on_the_floor))
