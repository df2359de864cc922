"""Constraints that are applied to the finished motion: kept body parts, loops, motion in place, blending. numpy."""
import warnings
from collections.abc import Sequence

import numpy as np

from motion_jax.control.compiling import angle_of
from motion_jax.control.constraints import Constraint, InPlace, KeepParts, Loop
from motion_jax.control.signal import rotate_about_y
from motion_jax.motion.filling import fill_frames
from motion_jax.motion.layering import put_on
from motion_jax.motion.looping import in_place, looped, turn_of_round, velocity
from motion_jax.motion.retarget import retarget, with_lengths
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D, with_own_lengths
from motion_jax.motion.splicing import REACH, meeting, spliced, weights
from motion_jax.shapes import Float, Num
from motion_jax.utils.errors import InputError

_EASE = 0.4   # seconds of the transition at a span's ends
_OTHER_BONES = 5e-3  # metres: a larger difference of bone lengths retargets the other parts
_SPARE = 1.2  # seconds of additional motion in which to search for a cycle
_OTHER = 0.15   # largest relative change of a cycle's speed
_AHEAD = 0.2    # seconds: weight of velocities relative to positions in comparisons of poses
_TRIED = 12     # number of candidate cycles, of which the smoothest is used
_NEAR = 0.1     # seconds around a seam in which its jerk is measured


def spare(fps: float) -> int:
  """Number of additional frames to generate, in which to search for a loop."""
  return round(_SPARE * fps)


def with_parts(generated: Num[np.ndarray, "t 22 3"], keep: KeepParts, fps: float = 20.0) -> Float[np.ndarray, "n 22 3"]:
  """Combines the kept parts of keep's motion with all other parts of generated: joints (N, 22, 3). float32.

  As long as the shorter of the two, with the kept body's bone lengths. The path over the ground belongs to the legs.
  """
  given = keep.joints if abs(keep.fps - fps) < 1e-3 else resample(keep.joints, keep.fps, fps)
  count = min(len(generated), len(given))
  generated, given = np.asarray(generated[:count], np.float64), np.asarray(given[:count], np.float64)
  skeleton = with_own_lengths(given, HUMANML3D)
  weight_of_new = _regenerated(keep, count, fps)
  kept, arms = set(keep.parts), ("left", "right")
  if "legs" in kept:
    body, other, weight = given, generated, weight_of_new
    theirs = [part for part in ("torso", "head", *arms) if _name(part) not in kept]
  else:
    if np.abs(skeleton.bone_lengths - HUMANML3D.bone_lengths).max() > _OTHER_BONES:
      generated = retarget(generated, skeleton)
    generated = generated if keep.spans is None else fill_frames(generated, given, weight_of_new > 0, skeleton, fps)
    body, other, weight = generated, given, np.ones(count)
    theirs = [part for part in ("torso", "head", *arms) if _name(part) in kept]
  result = body
  if "torso" in theirs:  # replaces head and arms, too: restore those that belong to the body
    result = put_on(result, other, "torso", (), weight, HUMANML3D)
    source, parts = body, [part for part in ("head", *arms) if part not in theirs]
  else:
    source, parts = other, theirs
  for part in parts:
    result = put_on(result, source, *(("head", ()) if part == "head" else ("arms", (part,))), weight, HUMANML3D)
  return result.astype(np.float32)


def _name(part: str) -> str:
  return f"{part}_arm" if part in ("left", "right") else part


def _regenerated(keep: KeepParts, count: int, fps: float) -> Float[np.ndarray, " t"]:
  """Weight (T,) of the generated motion, 0 to 1: 1 without spans, else 1 inside them with smooth borders."""
  if keep.spans is None:
    return np.ones(count)
  time, weight = np.arange(count) / fps, np.zeros(count)
  for first, last in keep.spans:
    inside = np.minimum((time - first) / _EASE if first > 0 else np.inf, (last - time) / _EASE)
    weight = np.maximum(weight, np.clip(inside, 0, 1))
  return weight * weight * (3 - 2 * weight)


def finalize(joints: Num[np.ndarray, "t 22 3"], constraints: Sequence[Constraint], fps: float = 20.0,
             count: int | None = None) -> tuple[Float[np.ndarray, "n 22 3"], Float[np.ndarray, "3"]]:
  """Applies the constraints on the whole motion, `Loop` and `InPlace`: (joints, `looping.velocity` before `InPlace`).

  count: length of the cycle to search for, without the closing frame that repeats the first; None closes the whole
  motion and keeps its path over the ground. Warns about a loop in place that turns in each round.
  """
  kinds = {type(constraint) for constraint in constraints}
  if Loop in kinds:
    joints = cycle(joints, count + 1, fps) if count else looped(joints, fps, keep_way=True)
  if {Loop, InPlace} <= kinds and abs(turn := np.degrees(turn_of_round(joints))) % 360 > 1:
    warnings.warn(f"the body turns by {turn:.0f} degrees in each round of this loop; it faces its beginning again only "
                  "where the root's turn is played too (root motion)", stacklevel=2)
  return in_place(joints) if InPlace in kinds else np.asarray(joints, np.float32), velocity(joints, fps)


def cycle(joints: Num[np.ndarray, "t 22 3"], count: int, fps: float = 20.0) -> Float[np.ndarray, "n 22 3"]:
  """Extracts a loop of count frames from a motion of at least as many: its last frame is the first of the next round.

  It begins and ends at similar poses and velocities, 0.85 to 1.15 count frames apart, is resampled to count frames, and
  the remaining difference fades at both ends. Of the best candidates the one with the smoothest seam is used. It begins
  at x = z = 0 and faces +z on average.
  """
  joints = np.asarray(joints, np.float64)
  if count < 4 or len(joints) < count:
    raise InputError(f"got a motion of {len(joints)} frames for a loop of {count}, expected 4 frames or more, and as "
                     "many in the motion")
  loops = (_played(joints[first:last + 1], count, fps) for first, last in _meets(joints, count, fps))
  best = min(loops, key=lambda loop: _roughness(loop, fps)).astype(np.float64)
  ways = np.exp(1j * angle_of(best))
  mean = ways.mean() if abs(ways.mean()) > 0.5 else ways[0]  # for a spinning body the first heading
  return rotate_about_y(best - best[:1, :1] * [1, 0, 1], np.full((1, 1), -np.angle(mean))).astype(np.float32)


def _played(part: np.ndarray, count: int, fps: float) -> Float[np.ndarray, "n 22 3"]:
  """Part of a motion, resampled to a loop of count frames."""
  if len(part) != count:
    from scipy.interpolate import CubicSpline
    when = np.linspace(0, len(part) - 1, count)
    part = with_lengths(CubicSpline(np.arange(len(part)), part)(when), HUMANML3D)
  return looped(part, fps)


def _roughness(loop: np.ndarray, fps: float) -> float:
  """Largest jerk of a loop at its seam relative to that elsewhere: means over the joints, in the body's frame."""
  body = rotate_about_y(loop - loop[:, :1] * [1, 0, 1], -angle_of(loop)[:, None])[:-1]
  jerk = np.linalg.norm(np.diff(np.concatenate([body[-4:], body, body[:4]]), n=3, axis=0), axis=-1).mean(1)
  near = round(_NEAR * fps) + 4
  inside = jerk[near:-near]
  return float(np.append(jerk[:near], jerk[-near:]).max() / max(inside.max(initial=0.0), 1e-9))


def _meets(joints: np.ndarray, count: int, fps: float) -> list[tuple[int, int]]:
  """Candidate cycles (first frame, last frame) of a motion, the most similar ends first."""
  ground = joints[:, :1] * [1, 0, 1]
  body = rotate_about_y(joints - ground, -angle_of(joints)[:, None])
  way = rotate_about_y(np.gradient(joints, axis=0) * fps * _AHEAD, -angle_of(joints)[:, None])
  seen = np.concatenate([body, way], axis=1) * np.sqrt(np.tile(weights(), 2))[:, None]
  seen = seen.reshape(len(joints), -1)
  away = ((seen[:, None] - seen[None]) ** 2).sum(-1) if len(seen) <= 400 else None
  candidates = []
  for length in range(max(4, int(np.ceil(count * (1 - _OTHER)))), min(len(joints), int(count * (1 + _OTHER))) + 1):
    firsts = np.arange(len(joints) - length + 1)
    off = (away[firsts, firsts + length - 1] if away is not None else
           ((seen[firsts] - seen[firsts + length - 1]) ** 2).sum(-1))
    off = off * (1 + abs(length / count - 1))  # prefer the smaller change of speed
    candidates += [(float(off[first]), int(first), int(first) + length - 1) for first in np.argsort(off)[:_TRIED]]
  return [(first, last) for _, first, last in sorted(candidates)[:_TRIED]]


def blend(first: Num[np.ndarray, "m 22 3"], second: Num[np.ndarray, "n 22 3"], seconds: float = 1.0, fps: float = 20.0
          ) -> tuple[Float[np.ndarray, "t 22 3"], int]:
  """Blends the first motion into the second: (joints (T, 22, 3), frame from which the second plays).

  The second is moved and turned on the ground to continue the first. The transition is at the most similar poses within
  half of `seconds` of the first's end and the second's beginning; the offset fades within `seconds`, except for
  standing feet (`motion.splicing`). Both have the bone lengths of our skeleton.
  """
  for joints in (first, second):
    if len(joints) < 2 * REACH + 2:
      raise InputError(f"got a motion of {len(joints)} frames to be blended, expected {2 * REACH + 2} or more")
  if not 2 / fps <= seconds <= 10:
    raise InputError(f"got {seconds:g} seconds for the way from one motion to the other, expected {2 / fps:g} to 10")
  half = int(seconds * fps / 2)
  leaves = range(max(REACH, len(first) - REACH - 1 - half), len(first) - REACH)
  enters = range(REACH, min(REACH + half, len(second) - REACH - 2) + 1)
  near = lambda joints, at: joints[at - REACH:at + REACH + 1]
  at = min(((leave, enter) for leave in leaves for enter in enters),
           key=lambda pair: meeting(near(first, pair[0]), near(second, pair[1])).distance)
  blended = spliced(first, at[0], second, at[1], fade=max(2, round(seconds * fps)))
  return blended.astype(np.float32), at[0] + 1
