"""Pauses in a motion: playback slows down, stops and continues, at the frame near the requested one that suits best."""
from collections.abc import Sequence

import numpy as np

from motion_jax.motion.layering import turned_towards
from motion_jax.motion.retarget import bend_leg
from motion_jax.motion.skeleton import Skeleton
from motion_jax.shapes import Float, Num

_EASE = 8         # frames in which the body stops, and in which it continues
_BEFORE, _AFTER = 16, 8  # frames before and after the requested one in which the pause may begin
_LIFTED = 0.05    # metres; a foot with its ankle this far above its lowest height is put down for the pause
_DOWN = 12        # frames to put a foot down, and to lift it again
_NEARLY = 0.04    # metres; poses this close to the highest or lowest count as equal, and the slowest is held
_UP = 5.0         # weight of a foot's height in metres relative to its speed in metres per second


def insert_pause(joints: Num[np.ndarray, "t j 3"], at: int, count: int, skeleton: Skeleton, ends: bool = False,
                 exact: bool = False, earliest: int = 0) -> tuple[Float[np.ndarray, "n j 3"], int, int]:
  """Insert a pause of about `count` frames near frame `at`; returns (joints (T + count, J, 3) float32, first frame of
  the pause, frame past its last).

  The pause begins where both feet are on the ground and slow. The body stops within 0.4 s and continues as before, so
  the pause adds no foot skating. A foot that is in the air even there, as in running, is put down below its hip.
  at = 0: the body stands from the first frame on; frames before the best stand are dropped. ends: the motion ends in
  the pause. exact: pause at frame `at` itself, in its pose (`held_frame`). earliest: first frame allowed, unless exact.
  """
  joints = np.asarray(joints, np.float64)
  stop = min(at, len(joints) - 1) if exact else _best_stand(joints, at, earliest, skeleton)
  ease = min(_EASE, 2 * stop, count // 2 * 2)
  # The average speed while stopping is one half, so it takes twice the frames that it plays.
  slow = stop - ease / 2 + _eased(ease)
  times = [np.arange(stop - ease // 2 + 1), slow] if at else []
  if ends:
    times.append(np.full(max(len(joints) + count - sum(map(len, times)), 0), stop))
  else:
    start = min(_EASE, 2 * (len(joints) - 1 - stop), (count - ease // 2) // 2 * 2)
    fast = stop + start / 2 - _eased(start)[::-1]
    rest = np.arange(stop + start // 2, len(joints))
    times.append(np.full(max(len(joints) + count - sum(map(len, times)) - start - len(rest), 0), stop))
    times += [fast, rest]
  when = np.clip(np.concatenate(times), 0, len(joints) - 1)
  low = np.minimum(when.astype(int), len(joints) - 2) if len(joints) > 1 else np.zeros(len(when), int)
  part = (when - low)[:, None, None]
  moved = joints[low] * (1 - part) + joints[np.minimum(low + 1, len(joints) - 1)] * part
  still = np.flatnonzero(when == stop)
  first, past = int(still[0]), int(still[-1]) + 1
  if not exact:
    moved = _feet_down(moved, first, past, joints[:, :, 1].min(0), skeleton, ends)
  return moved.astype(np.float32), first, past


def held_frame(joints: Num[np.ndarray, "t j 3"], first: int, past: int, pose: str, sides: Sequence[str],
               skeleton: Skeleton) -> int:
  """The frame of joints (T, J, 3), from `first` to `past`, that shows a pose best; the slowest of nearly equal ones.

  pose: "arms", highest wrists of `sides` (of any arm if empty); "low", lowest pelvis; "leg", one ankle highest above
  the other.
  """
  part = np.asarray(joints[first:past], np.float64) * skeleton.unit
  ankles = part[:, [chain[3] for chain in skeleton.chains[:2]], 1]
  wrists = part[:, [chain[-1] for chain in skeleton.chains[3:]], 1]
  named = [i for i, side in enumerate(("right", "left")) if side in sides]
  much = (-part[:, 0, 1] if pose == "low" else np.abs(ankles[:, 0] - ankles[:, 1]) if pose == "leg" else
          wrists[:, named].mean(1) if named else wrists.max(1))
  speed = np.linalg.norm(np.gradient(part, axis=0), axis=-1).mean(1) if len(part) > 1 else np.zeros(1)
  return first + int(np.argmin(np.where(much >= much.max() - _NEARLY, speed, np.inf)))


def _feet_down(joints, first, past, lowest, skeleton, ends):
  """Put both feet of joints (T, J, 3) on the ground from frame `first` to `past`; lowest (J,): least heights."""
  k = np.arange(len(joints))
  weight = np.clip((k - first) / _DOWN + 1, 0, 1) * (1 if ends else np.clip((past - k) / _DOWN + 1, 0, 1))
  weight = weight ** 2 * (3 - 2 * weight)
  result, legs = joints.copy(), [chain[1:] for chain in skeleton.chains[:2]]
  for leg, other in zip(legs, legs[::-1]):
    hip, ankle = leg[0], leg[2]
    now = joints[first, ankle]
    if (now[1] - lowest[ankle]) * skeleton.unit < _LIFTED:
      continue
    below = np.array([joints[first, hip, 0], lowest[ankle], joints[first, hip, 2]])
    bend_leg(joints, result, leg, weight[:, None] * (below - now), skeleton)
    for above, joint, like, alike in zip(leg[2:-1], leg[3:], other[2:-1], other[3:]):  # tilt the sole as the other one
      flat = np.broadcast_to(joints[first, alike] - joints[first, like], (len(joints), 3))
      result[:, joint] = result[:, above] + turned_towards(joints[:, joint] - joints[:, above], flat, weight)
  return result


def _eased(count):
  """Frames passed (count,) while playback slows down from full speed to zero."""
  k = np.arange(1, count + 1) / max(count, 1)
  return count * (k - k ** 2 / 2)


def _best_stand(joints, at, earliest, skeleton):
  feet = joints[:, [*skeleton.left_feet, *skeleton.right_feet]] * skeleton.unit
  speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1).sum(-1) * skeleton.fps if len(joints) > 1 else np.zeros(1)
  height = (feet[..., 1] - feet[..., 1].min(0)).sum(-1)
  first = max(at - _BEFORE, min(earliest, at), 0)
  past = min(at + _AFTER, len(joints))
  return first + int(np.argmin((speed + _UP * height)[first:past])) if past > first else len(joints) - 1
