"""What is made of a finished motion: parts of the body as in another, a loop, a body that stays in its place."""
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Num

from motion_jax.control.constraints import Constraint, InPlace, KeepParts, Loop
from motion_jax.control.loops import cycle
from motion_jax.data.mocap.capture import resample
from motion_jax.motion.blending import join
from motion_jax.motion.layering import put_on
from motion_jax.motion.looping import in_place, looped
from motion_jax.motion.skeleton import HUMANML3D

_EASE = 0.4   # seconds in which a part comes to another motion's and goes back, at a span's ends
_SPARE = 1.2  # seconds more of a motion in which a cycle is looked for


def spare(fps: float) -> int:
  """Frames that a motion is made longer for a loop to be found in it."""
  return round(_SPARE * fps)


def with_parts(made: Num[np.ndarray, "t 22 3"], keep: KeepParts, fps: float = 20.0) -> Float[np.ndarray, "n 22 3"]:
  """Joints (N, 22, 3) whose parts are those of the motion that keep holds, all others as made; as long as the shorter
  of the two. With the legs goes the way over the ground. float32.
  """
  given = keep.joints if abs(keep.fps - fps) < 1e-3 else resample(keep.joints, keep.fps, fps)
  count = min(len(made), len(given))
  made, given = np.asarray(made[:count], np.float64), np.asarray(given[:count], np.float64)
  anew = _anew(keep, count, fps)
  kept, arms = set(keep.parts), ("left", "right")
  if "legs" in kept:
    body, other, theirs, weight = given, made, [part for part in ("torso", "head", *arms) if _name(part) not in kept
                                                ], anew
  else:
    made = made if keep.spans is None else join(made, given, anew <= 0).astype(np.float64)
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


def _anew(keep: KeepParts, count: int, fps: float) -> Float[np.ndarray, " t"]:
  """How much of each frame (T,) is made anew, 0 to 1: all, or the spans, which come and go smoothly."""
  if keep.spans is None:
    return np.ones(count)
  time, weight = np.arange(count) / fps, np.zeros(count)
  for first, last in keep.spans:
    inside = np.minimum((time - first) / _EASE if first > 0 else np.inf, (last - time) / _EASE)
    weight = np.maximum(weight, np.clip(inside, 0, 1))
  return weight * weight * (3 - 2 * weight)


def finished(joints: Num[np.ndarray, "t 22 3"], constraints: Sequence[Constraint], fps: float = 20.0,
             count: int | None = None) -> Float[np.ndarray, "n 22 3"]:
  """The motion as a loop, and in its place, where that is asked for. count: frames of a cycle to be looked for in it;
  None loops all of it, and leaves the way over the ground as it is."""
  kinds = {type(one) for one in constraints}
  if Loop in kinds:
    joints = cycle(joints, count, fps) if count else looped(joints, fps, keep_way=True)
  return in_place(joints) if InPlace in kinds else np.asarray(joints, np.float32)
