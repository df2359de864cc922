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

_EASE = 0.4   # seconds in which a part comes to another motion's and goes back, at a span's ends
_OTHER_BONES = 5e-3  # metres that bones may differ by before the other parts are brought to them
_SPARE = 1.2  # seconds more of a motion in which a cycle is looked for
_OTHER = 0.15   # of its length by which a cycle may be played faster or slower than it was made
_AHEAD = 0.2    # seconds of movement that count as much as a pose, when poses are compared
_TRIED = 12     # cycles of those that meet best that are made, for the smoothest to be taken
_NEAR = 0.1     # seconds around a seam in which it is felt


def spare(fps: float) -> int:
  """Extra frames to generate so that a loop can be found in the motion."""
  return round(_SPARE * fps)


def with_parts(made: Num[np.ndarray, "t 22 3"], keep: KeepParts, fps: float = 20.0) -> Float[np.ndarray, "n 22 3"]:
  """Joints (N, 22, 3) whose parts are those of the motion that keep holds, all others as made; as long as the shorter
  of the two, on the kept body's bones. With the legs goes the way over the ground. float32.
  """
  given = keep.joints if abs(keep.fps - fps) < 1e-3 else resample(keep.joints, keep.fps, fps)
  count = min(len(made), len(given))
  made, given = np.asarray(made[:count], np.float64), np.asarray(given[:count], np.float64)
  own = with_own_lengths(given, HUMANML3D)
  weight_of_new = _regenerated(keep, count, fps)
  kept, arms = set(keep.parts), ("left", "right")
  if "legs" in kept:
    body, other, theirs, weight = given, made, [part for part in ("torso", "head", *arms) if _name(part) not in kept
                                                ], weight_of_new
  else:
    if np.abs(own.bone_lengths - HUMANML3D.bone_lengths).max() > _OTHER_BONES:
      made = retarget(made, own)
    made = made if keep.spans is None else fill_frames(made, given, weight_of_new > 0, own, fps)
    body, other, theirs, weight = made, given, [part for part in ("torso", "head", *arms) if _name(part) in kept
                                                ], np.ones(count)
  result = body
  if "torso" in theirs:  # takes head and arms along: those of the body's own motion are put back
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
  """Weight (T,) of the new motion in each frame, 0 to 1: 1 without spans, else 1 inside them with smooth borders."""
  if keep.spans is None:
    return np.ones(count)
  time, weight = np.arange(count) / fps, np.zeros(count)
  for first, last in keep.spans:
    inside = np.minimum((time - first) / _EASE if first > 0 else np.inf, (last - time) / _EASE)
    weight = np.maximum(weight, np.clip(inside, 0, 1))
  return weight * weight * (3 - 2 * weight)


def finalize(joints: Num[np.ndarray, "t 22 3"], constraints: Sequence[Constraint], fps: float = 20.0,
             count: int | None = None) -> tuple[Float[np.ndarray, "n 22 3"], Float[np.ndarray, "3"]]:
  """Applies the constraints that need the whole motion, `Loop` and `InPlace`; and the mean velocity over the ground as
  the body sees it (`looping.velocity`), which a motion in place has lost.

  count: frames of the cycle to search for, to which a closing one is added that is the first again; None closes the
  whole motion and keeps its way over the ground. Warns where a loop in place turns in each round.
  """
  kinds = {type(one) for one in constraints}
  if Loop in kinds:
    joints = cycle(joints, count + 1, fps) if count else looped(joints, fps, keep_way=True)
  if {Loop, InPlace} <= kinds and abs(turn := np.degrees(turn_of_round(joints))) % 360 > 1:
    warnings.warn(f"the body turns by {turn:.0f} degrees in each round of this loop; it faces its beginning again only "
                  "where the root's turn is played too (root motion)", stacklevel=2)
  return in_place(joints) if InPlace in kinds else np.asarray(joints, np.float32), velocity(joints, fps)


def cycle(joints: Num[np.ndarray, "t 22 3"], count: int, fps: float = 20.0) -> Float[np.ndarray, "n 22 3"]:
  """A loop of count frames out of a motion of as many or more: its last frame is its first of the next round.

  It begins and ends where pose and movement of the body are alike, the way between them 0.85 to 1.15 of count frames,
  played at the rate that makes count of them; the rest of the difference fades at both ends. Of the cycles that meet
  best that with the smoothest seam is taken. It begins at x = z = 0 and faces +z on average.
  """
  joints = np.asarray(joints, np.float64)
  if count < 4 or len(joints) < count:
    raise InputError(f"got a motion of {len(joints)} frames for a loop of {count}, expected 4 frames or more, and as "
                     "many in the motion")
  made = (_played(joints[first:last + 1], count, fps) for first, last in _meets(joints, count, fps))
  best = min(made, key=lambda loop: _roughness(loop, fps)).astype(np.float64)
  ways = np.exp(1j * angle_of(best))
  mean = ways.mean() if abs(ways.mean()) > 0.5 else ways[0]  # of a body that spins, as it begins
  return rotate_about_y(best - best[:1, :1] * [1, 0, 1], np.full((1, 1), -np.angle(mean))).astype(np.float32)


def _played(part: np.ndarray, count: int, fps: float) -> Float[np.ndarray, "n 22 3"]:
  """A part of a motion as a loop of count frames."""
  if len(part) != count:
    from scipy.interpolate import CubicSpline
    when = np.linspace(0, len(part) - 1, count)
    part = with_lengths(CubicSpline(np.arange(len(part)), part)(when), HUMANML3D)
  return looped(part, fps)


def _roughness(loop: np.ndarray, fps: float) -> float:
  """The largest jerk of a loop at its seam, as a share of that of its inside: means over the joints, of the body as it
  sees itself."""
  body = rotate_about_y(loop - loop[:, :1] * [1, 0, 1], -angle_of(loop)[:, None])[:-1]
  jerk = np.linalg.norm(np.diff(np.concatenate([body[-4:], body, body[:4]]), n=3, axis=0), axis=-1).mean(1)
  near = round(_NEAR * fps) + 4
  inside = jerk[near:-near]
  return float(np.append(jerk[:near], jerk[-near:]).max() / max(inside.max(initial=0.0), 1e-9))


def _meets(joints: np.ndarray, count: int, fps: float) -> list[tuple[int, int]]:
  """The first and last frames between which a motion is most like a cycle, the likest first."""
  ground = joints[:, :1] * [1, 0, 1]
  body = rotate_about_y(joints - ground, -angle_of(joints)[:, None])
  way = rotate_about_y(np.gradient(joints, axis=0) * fps * _AHEAD, -angle_of(joints)[:, None])
  seen = np.concatenate([body, way], axis=1) * np.sqrt(np.tile(weights(), 2))[:, None]
  seen = seen.reshape(len(joints), -1)
  away = ((seen[:, None] - seen[None]) ** 2).sum(-1) if len(seen) <= 400 else None
  found = []
  for length in range(max(4, int(np.ceil(count * (1 - _OTHER)))), min(len(joints), int(count * (1 + _OTHER))) + 1):
    firsts = np.arange(len(joints) - length + 1)
    off = (away[firsts, firsts + length - 1] if away is not None else
           ((seen[firsts] - seen[firsts + length - 1]) ** 2).sum(-1))
    off = off * (1 + abs(length / count - 1))  # of two that meet as well, the one that is less hastened
    found += [(float(off[first]), int(first), int(first) + length - 1) for first in np.argsort(off)[:_TRIED]]
  return [(first, last) for _, first, last in sorted(found)[:_TRIED]]


def blend(first: Num[np.ndarray, "m 22 3"], second: Num[np.ndarray, "n 22 3"], seconds: float = 1.0, fps: float = 20.0
          ) -> tuple[Float[np.ndarray, "t 22 3"], int]:
  """(the first motion going over into the second (T, 22, 3), the frame from which the second plays).

  The second is moved and turned on the ground to go on from the first. It is entered, and the first left, where their
  poses are most alike within half of `seconds` from the end and from the beginning; what they differ by fades within
  `seconds`, but not of a foot while it stands (`motion.splicing`). Both have the bones of our skeleton.
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
  made = spliced(first, at[0], second, at[1], fade=max(2, round(seconds * fps)))
  return made.astype(np.float32), at[0] + 1
