"""Join generated frames to kept ones without a jump, by inertialization at the borders."""
from collections.abc import Iterable

import numpy as np

from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Array, Bool, Float, Num

_FADE = 12      # frames over which an offset of pose and speed fades: 0.6 s at 20 frames a second
_ALIGN = 6      # frames by which two motions are aligned
_HASTE, _BESIDE, _CALM = 0.05, 0.3, 0.1  # seconds: centre of the smoothing after a border, its reach and its width
_SWERVE = 0.15  # metres by which a joint's step across a border may differ from the neighbouring steps


def join(generated: Num[Array, "t j 3"], given: Num[Array, "t j 3"], kept: Bool[Array, " t"], fade: int = _FADE
         ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3): `given` where kept (T,), elsewhere `generated` without jumps at the borders. float32.

  generated and given (T, J, 3), metres, agree in the kept frames up to the error of the network. The offset of position
  and speed at a border is subtracted from the generated frames. The offset of the pose fades within `fade` frames; the
  offset over the ground stays, since new frames continue from the kept ones. Between two kept parts the path is
  stretched to meet both. This is known as inertialization (D. Bollo, GDC 2018).
  """
  generated, given, kept = np.asarray(generated, np.float64), np.asarray(given, np.float64), np.asarray(kept, bool)
  if generated.shape != given.shape or kept.shape != generated.shape[:1]:
    raise ValueError(f"got joints of shapes {generated.shape} and {given.shape} with {kept.shape} frames kept or not; "
                     "expected the same frames of all")
  result = np.where(kept[:, None, None], given, generated)
  edges = np.flatnonzero(np.diff(np.concatenate([[True], kept, [True]]).astype(int)))
  for first, past in zip(edges[::2], edges[1::2]):
    new, closed = generated[first:past], first > 0
    if first > 0:
      new = new + _correction(generated[:past], given[:past], kept[:past], first, fade)
    if past < len(kept):
      # Backwards in time from this border. If the other border was joined first, the path is stretched.
      moved = np.concatenate([generated[:first], new, generated[past:] + (new[-1] - generated[past - 1])])[::-1]
      back = len(kept) - past
      new = new + _correction(moved, given[::-1], kept[::-1], back, fade, past - first, closed)[::-1]
    result[first:past] = new
  return result.astype(np.float32)


def _correction(generated, given, kept, first, fade, count=None, closed=False):
  """The offset (N, J, 3) to add to generated[first:], which then continues given[first - 1].

  closed: the other end of the N frames does not move.
  """
  count = len(generated) - first if count is None else count
  last = first - 1
  step = generated[first] - generated[last]
  away, drift = given[last] - generated[last], np.zeros_like(step)
  beside = [generated[first + 1] - generated[first]] if count > 1 else []
  if last > 0 and kept[last - 1]:
    drift = (given[last] - given[last - 1]) - (generated[last] - generated[last - 1])
    beside.append(generated[last] - generated[last - 1])
  if beside:  # a step that is like neither of its neighbours is a jump
    swerve = step - np.mean(beside, axis=0)
    size = np.linalg.norm(swerve, axis=-1, keepdims=True)
    away = away - swerve * (1 - np.minimum(1, _SWERVE / np.maximum(size, 1e-9)))
  ground = np.array([1.0, 0.0, 1.0])
  away_root, drift_root = away[:1] * ground, drift[:1] * ground
  width = min(fade, count)
  k = np.arange(1, count + 1)[:, None, None]
  s = np.minimum(k / (width + 1), 1)
  pose = (away - away_root) * (1 - 3 * s ** 2 + 2 * s ** 3) + (drift - drift_root) * (width + 1) * s * (1 - s) ** 2
  way = away_root + drift_root * (width + 1) * (s - s ** 2 + s ** 3 / 3)
  return pose + (way * (1 - k / (count + 1)) if closed else way)


def eased(joints: Num[Array, "t j 3"], borders: Iterable[int], fps: float = 20.0) -> Float[np.ndarray, "t j 3"]:
  """Smooths joints (T, J, 3) at the borders between prompts. float32.

  After a change of prompt, a generated motion moves to its new pose within a few frames. Joints are smoothed there by a
  Gaussian of 0.1 s whose weight fades within 0.3 s to either side. Frames farther away stay unchanged.
  """
  joints = np.asarray(joints)
  result, frames = joints.astype(np.float64), np.arange(len(joints))
  weight = np.zeros(len(joints))
  for border in borders:
    away = np.abs(frames - border - _HASTE * fps) / (_BESIDE * fps)
    weight = np.maximum(weight, np.cos(np.pi / 2 * np.minimum(away, 1)) ** 2 * (away < 1))
  calm = gaussian_filter1d(result, _CALM * fps, axis=0, mode="nearest")
  return (result + weight[:, None, None] * (calm - result)).astype(np.float32)


def laid_over(shadow: Float[np.ndarray, "n j 3"], joints: Num[np.ndarray, "t j 3"], count: int
              ) -> Float[np.ndarray, "_ j 3"]:
  """Frames count.. of shadow (N, J, 3), aligned to continue joints (T, J, 3).

  The first `count` frames of shadow repeat the end of joints at another position; the remaining difference fades.
  """
  near = min(_ALIGN, count)
  centre, turn, aim = _fitted(shadow[count - near:count], joints[-near:])
  moved = (shadow[count - 1:] - centre) @ turn.T + aim
  fade = (1 + np.cos(np.pi * np.clip(np.arange(len(moved)) / _FADE, 0, 1))) / 2
  return (moved + fade[:, None, None] * (joints[-1] - moved[0]))[1:]


def _fitted(ours: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
  """(centre, turn (3, 3) about y, aim) that bring joints (N, J, 3) onto others best: (x - centre) @ turn.T + aim."""
  centre, aim = ours.mean((0, 1)), theirs.mean((0, 1))
  a, b = ((body - middle)[..., [0, 2]].reshape(-1, 2) for body, middle in ((ours, centre), (theirs, aim)))
  angle = np.arctan2((a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1]).sum(), (a * b).sum())  # about y, from z to x
  return centre, np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]), aim
