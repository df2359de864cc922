"""The pose that a capture file rests in, and the frame of it that some converters put before the motion."""
import dataclasses
import warnings

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import mirror
from motion_jax.motion.skeleton import HUMANML3D, body_axes

_JUMP = 20.0      # degrees that a joint turns from the pose to the motion, at least,
_SUDDEN = 4.0     # and how many times as much as in the frames behind
_FASTER = 1.5     # times as much as in the next step, where the pose is that of rest: motions may begin in it
_CROOKED = 0.05   # of the legs' length: how far a set pose's left side may be from its right one, on average
_BENT = 15.0      # degrees by which its elbows and knees may be bent


def rest_positions(capture):
  """Positions (1, N, 3) of a Capture's joints at rest: as its offsets say, without any rotation."""
  rest = np.array(capture.offsets, np.float64)
  for joint, parent in enumerate(capture.parents):
    if parent >= 0:
      rest[joint] += rest[parent]
  return rest[None]


def starts_with_a_pose(capture, joints=None, skeleton=HUMANML3D) -> bool:
  """Whether frame 0 is a pose put before the motion (as cgspeed does): a jump, from the rest pose or another set pose.

  joints (T, J, 3): the skeleton's, if known. Limbs of a set pose are straight, and its left side is like its right
  one, as in a T-pose or an A-pose; a captured body does not hold that and then jump.
  """
  if capture.num_frames < 3:
    return False
  q, steps = capture.rotations, _steps(capture)
  moving = _angles(rot.multiply(rot.conjugate(q[:1]), q)).max(0) > 1
  if moving.any() and _angles(q[0, moving]).mean() < 2 and steps[0] > max(5, _FASTER * steps[1]):
    return True
  usual = np.percentile(steps[4:] if len(steps) > 8 else steps[1:], 90)  # the first ones may be smeared
  return joints is not None and steps[0] > max(_JUMP, _SUDDEN * usual) and _is_set(joints[0], skeleton)


def without_pose(capture):
  """Drops frame 0. Where the converter's filter has smeared the pose into what follows (joints go on jumping, less and
  less), up to three frames take the first clean one's pose; the root keeps its own path, which is not filtered."""
  if capture.num_frames < 2:
    return capture
  steps = _steps(capture)[:4]
  smeared = 0
  if len(steps) == 4 and steps[1] > steps[0] / 3 and (np.diff(steps[1:]) < 0).all():
    smeared = 1 + int((steps[2:] > steps[1] / 4).sum())
  frames = np.maximum(np.arange(1, capture.num_frames), 1 + smeared)
  root = capture.positions[:, :1]
  positions = capture.positions[frames] - root[frames] + root[1:]
  return dataclasses.replace(capture, positions=positions, rotations=capture.rotations[frames],
                             turned=capture.turned[frames])


def warn_of_pose(name):
  warnings.warn(f"{name}: frame 0 is a pose set before the motion and is left out", stacklevel=3)


def _is_set(frame, skeleton):
  """Whether a pose (J, 3) has straight limbs and a left side like its right one."""
  limbs = [chain[1:4] for chain in skeleton.chains[:2]] + [chain[-3:] for chain in skeleton.chains[3:]]
  bones = [(frame[b] - frame[a], frame[c] - frame[b]) for a, b, c in limbs]
  straight = all((u * v).sum() > np.cos(np.radians(_BENT)) * np.linalg.norm(u) * np.linalg.norm(v) for u, v in bones)
  axes = body_axes(frame[None], skeleton)[0][0]
  local = (frame - frame[list(skeleton.hips)].mean(0)) @ axes
  legs = sum(np.linalg.norm(bone) for bone in bones[0])
  apart = np.linalg.norm(local - mirror(local, skeleton), axis=-1).mean()
  return bool(straight and apart < _CROOKED * legs)


def _steps(capture):
  """The largest turn of any joint, degrees, in each step (T - 1,)."""
  q = capture.rotations
  return _angles(rot.multiply(rot.conjugate(q[:-1]), q[1:])).max(-1)


def _angles(q):
  return np.degrees(2 * np.arccos(np.clip(np.abs(q[..., 0]), 0, 1)))
