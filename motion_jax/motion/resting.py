"""A moving body comes to rest: time slows down where it stands best, stands still, and goes on."""
import numpy as np
from jaxtyping import Float, Num

from motion_jax.motion.skeleton import Skeleton

_EASE = 8         # frames in which a body stops, and in which it goes on
_BEFORE, _BEHIND = 16, 8  # frames around the one asked for among which it stops
_UP = 5.0         # how much a foot in the air weighs, per metre, against its speed in metres a second


def with_rest(joints: Num[np.ndarray, "t j 3"], at: int, count: int, skeleton: Skeleton, ends: bool = False
              ) -> tuple[Float[np.ndarray, "n j 3"], int, int]:
  """Joints (T + count, J, 3) that stand still for about `count` frames near frame `at`; the first of these and the one
  behind the last.

  Where both feet are on the ground and slow, the body slows down within 0.4 s, and nothing moves until it goes on as it
  did; no foot slides that did not before. ends: it does not go on, and what is behind is left away. float32.
  """
  joints = np.asarray(joints, np.float64)
  stop = _best_stand(joints, at, skeleton)
  ease = min(_EASE, 2 * stop, count // 2 * 2)
  # At half the speed on average, stopping takes twice the frames that are passed on the way.
  slow = stop - ease / 2 + _eased(ease)
  times = [np.arange(stop - ease // 2), slow]
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
  return moved.astype(np.float32), int(still[0]), int(still[-1]) + 1


def _eased(count):
  """Frames passed (count,) while speed falls from one frame a frame to none."""
  k = np.arange(1, count + 1) / max(count, 1)
  return count * (k - k ** 2 / 2)


def _best_stand(joints, at, skeleton):
  feet = joints[:, [*skeleton.left_feet, *skeleton.right_feet]] * skeleton.unit
  speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1).sum(-1) * skeleton.fps if len(joints) > 1 else np.zeros(1)
  height = (feet[..., 1] - feet[..., 1].min(0)).sum(-1)
  first = max(at - _BEFORE, 0)
  past = min(at + _BEHIND, len(joints))
  return first + int(np.argmin((speed + _UP * height)[first:past])) if past > first else len(joints) - 1
