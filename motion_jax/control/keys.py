"""Keys of an animator: poses and targets with slack in time and with strength, as plain constraints of one motion."""
import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.control.compiling import FASTEST, compile
from motion_jax.control.constraints import Constraint, EffectorTarget, Keyframe
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, with_own_lengths
from motion_jax.shapes import Bool, Num

_PREFER = 1e-3  # metres a frame: a frame nearer to a key's own time is preferred by as much
_REACH = 0.9    # metres that a hand or foot moves without the body
_TOO_FAR = 10.0  # weight of metres that no body covers, relative to metres off the motion


def without_slack(constraints: Sequence[Constraint], joints: Num[np.ndarray, "t 22 3"], fps: float = 20.0,
                  new: Bool[np.ndarray, " t"] | None = None) -> list[Constraint]:
  """The constraints of a motion, joints (T, 22, 3), with each key at the best frame within its slack, at full strength.

  A key with slack moves to the frame in which the motion is nearest to it; keys of one joint stay in different frames.
  A key of strength s becomes the point or pose at share s of the way from the motion. new (T,): the frames that a key
  may move to.
  """
  new = np.ones(len(joints), bool) if new is None else new
  taken = {(joint_of(constraint), frame) for constraint in constraints if not getattr(constraint, "slack", 0)
           for frame in frames_of(constraint, fps, len(joints))}
  fixed: list[Constraint] = []
  for constraint in constraints:
    if getattr(constraint, "slack", 0):
      constraint = _at_best(constraint, joints, fps, new, taken)
      taken |= {(joint_of(constraint), frame) for frame in frames_of(constraint, fps, len(joints))}
    fixed.append(_on_the_way(constraint, joints, fps) if getattr(constraint, "strength", 1) < 1 else constraint)
  return fixed


def joint_of(constraint: Constraint) -> str:
  """The joint of a key, or the whole body."""
  return constraint.joint.replace("_", " ") if isinstance(constraint, EffectorTarget) else "the whole body"


def frames_of(constraint: Constraint, fps: float, count: int) -> list[int]:
  """Frames of a key's times in a motion of count frames; none of a constraint without times."""
  times = [constraint.time] if isinstance(constraint, Keyframe) else getattr(constraint, "times", None)
  if times is None:
    return []
  frames = np.floor(np.asarray(times) * fps + 0.5 + 1e-9).astype(int)
  return np.where(frames == count, count - 1, frames).tolist()  # "at 3 s" means the last frame of a motion of 3 s


class Distance(NamedTuple):
  """How far a key is from a kept frame: seconds from it, metres to it, and metres that a body covers in that time."""
  seconds: float
  metres: float
  covers: float
  frame: int
  joint: int

  @property
  def excess(self) -> float:
    return self.metres - self.covers


def farthest(constraint: Constraint, joints: Num[np.ndarray, "t 22 3"], new: Bool[np.ndarray, " t"], fps: float
             ) -> Distance | None:
  """The kept frame, one that is not new (T,), to which a key without slack has the most metres too far; None without
  kept frames."""
  places, given = _places(constraint, joints, fps)
  kept, distances = np.flatnonzero(~new), []
  for frame in frames_of(constraint, fps, len(joints)):
    joint = 0 if given[frame].all() else int(np.flatnonzero(given[frame])[0])
    for other in (*kept[kept < frame][-1:], *kept[kept > frame][:1]):
      seconds = abs(int(other) - frame) / fps
      metres = float(np.linalg.norm(places[frame, joint] - joints[other, joint]))
      distances.append(Distance(seconds, metres, FASTEST * seconds + _REACH * (joint != 0), int(other), joint))
  return max(distances, key=lambda distance: distance.excess, default=None)


def within_reach(constraints: Sequence[Constraint], joints: Num[np.ndarray, "t 22 3"], new: Bool[np.ndarray, " t"],
                 fps: float) -> tuple[list[Constraint], list[str]]:
  """(keys without slack, those that no body can reach from the kept frames moved to where it can; a sentence for each
  of these)."""
  near, notes = [], []
  for constraint in constraints:
    far = farthest(constraint, joints, new, fps)
    if far is not None and far.excess > 0:
      frame, = frames_of(constraint, fps, len(joints))[:1]
      slack = int(np.ceil((far.metres - far.covers) / FASTEST * fps - 1e-6))
      notes.append(
          f"the key of {joint_of(constraint)} at {frame / fps:.2f} s (frame {frame}) cannot be met: it is "
          f"{far.metres:.1f} m from where that is at {far.frame / fps:.2f} s, and a body covers {far.covers:.1f} m in "
          f"{far.seconds:.2f} s; a slack of {slack} frames ({slack / fps:.2f} s) or a wider span gives it the time")
      start = joints[far.frame, far.joint]
      share = far.covers / far.metres
      if isinstance(constraint, Keyframe):
        back = (start - _places(constraint, joints, fps)[0][frame, 0]) * (1 - share)
        constraint = dataclasses.replace(constraint, joints=constraint.joints + back, place="world")
      else:
        places = _places(constraint, joints, fps)[0][frames_of(constraint, fps, len(joints)), far.joint]
        constraint = dataclasses.replace(constraint, positions=start + (places - start) * share, relative_to="world")
    near.append(constraint)
  return near, notes


def _shifted(constraint: Constraint, seconds: float) -> Constraint:
  when = ({"time": max(constraint.time + seconds, 0.0)} if isinstance(constraint, Keyframe) else
          {"times": np.maximum(constraint.times + seconds, 0.0)})
  return dataclasses.replace(constraint, slack=0.0, **when)


def _places(constraint: Constraint, joints: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
  """(positions (T, 22, 3), whether they are given (T, 22)) of one key on a motion."""
  signal = compile([constraint], len(joints), fps, joints)
  return np.asarray(signal.positions[0], np.float64), np.asarray(signal.given)[0].any(-1)


def _at_best(constraint, joints, fps, new, taken):
  """The key at the frame within its slack, of those that are new, in which the motion is nearest to it."""
  frames, reach = frames_of(constraint, fps, len(joints)), round(constraint.slack * fps)
  best, least = _shifted(constraint, 0.0), np.inf
  for shift in sorted(range(-reach, reach + 1), key=abs):
    moved = [frame + shift for frame in frames]
    if moved[0] < 0 or moved[-1] >= len(new) or not new[moved].all() or (
        taken & {(joint_of(constraint), frame) for frame in moved}):
      continue
    candidate = _shifted(constraint, shift / fps)
    places, given = _places(candidate, joints, fps)
    far = farthest(candidate, joints, new, fps)
    away = np.linalg.norm(places - joints, axis=-1)[given].mean() + _PREFER * abs(shift) + (
        _TOO_FAR * max(far.excess, 0.0) if far else 0.0)
    if away < least:
      best, least = candidate, away
  return best


def _on_the_way(constraint, joints, fps):
  """The key at the share `strength` of the way from the motion to it, in world coordinates."""
  places, given = _places(constraint, joints, fps)
  frames = [frame for frame in frames_of(constraint, fps, len(joints)) if frame < len(joints)]
  way = joints[frames] + constraint.strength * (places[frames] - joints[frames])
  if isinstance(constraint, Keyframe):
    way = with_lengths(way, with_own_lengths(np.asarray(constraint.joints)[None], HUMANML3D))
    return dataclasses.replace(constraint, joints=way[0], place="world", strength=1.0)
  joint = int(np.flatnonzero(given[frames[0]])[0])
  return dataclasses.replace(constraint, positions=way[:, joint], relative_to="world", strength=1.0)
