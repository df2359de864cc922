"""Fill frames between kept ones: same bones, no jump at the borders, feet that do not slide.

A network that edits a motion returns all of it, elsewhere on the ground and within its error. `fill_frames` takes the
new frames only: it aligns them rigidly to the kept neighbours, spreads the remaining difference over the new frames
(inertialization, D. Bollo, GDC 2018), restores the bone lengths and pins the feet. Kept frames stay bit for bit.
numpy, float64, whole clips.
"""
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.pinned_feet import pin_feet
from motion_jax.motion.retarget import floor_height, with_lengths
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.motion.splicing import Meeting, laid, meeting
from motion_jax.shapes import Array, Bool, Float, Num

_FADE = 0.6       # seconds in which a difference of pose fades
_USUAL_JUMP = 0.02  # metres that a joint's step across a border may differ from the neighbouring steps
_MOST_DRIFT = 1.5  # metres a second: largest difference of a joint's speed, relative to the pelvis, that is corrected
_QUICK = (10.0, 20.0)  # radians a second of a bone: smoothing begins at the first and is complete at the second
_HASTE = 6        # frames after a border in which a fast bone counts as snapping to its new pose
_FOLLOW = 2.0     # frames for which such a bone continues the kept movement
_CALM = 1.5       # frames: width of the smoothing
_PAUSE = 2e-3     # metres a frame that a resting body counts as moving where a difference of position is spread
_CARRIED = 0.35   # metres a second at which the certainty that a foot stands is halved
# Weights of a foot's correction relative to sliding: its first and second difference, and its size.
_EASE, _BEND, _PULL = 0.01, 0.05, 1e-6
_FAR, _PULL_BACK = 0.08, 0.05  # metres that a foot may be moved freely, and the weight of its size at twice that
_ALIGN = 8        # kept frames by which new ones are aligned
_BESIDE = 4       # kept frames on either side that the solution of the legs includes


class Border(NamedTuple):
  """How generated frames continue the kept frames at one border; time is reversed at the border that ends them.

  at: the alignment onto the kept frames; away, drift (J, 3): the remaining offset of position and of speed, per frame,
  in the last kept frame.
  """
  at: Meeting
  away: np.ndarray
  drift: np.ndarray


def fill_frames(generated: Num[Array, "t j 3"], given: Num[Array, "t j 3"], new: Bool[Array, " t"],
                skeleton: Skeleton = HUMANML3D, fps: float = 20.0, fix_body: bool = True
                ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3): `given` where not new (T,), elsewhere `generated`, aligned to continue the kept frames.

  skeleton: has the bone lengths of given; those of generated are similar. fix_body: restore them in the new frames and
  pin standing feet; without it frames are only aligned and blended. Between two kept parts the remaining difference of
  position and heading is spread over the frames in which the body moves. float64.
  """
  generated, given, new = np.asarray(generated, np.float64), np.asarray(given, np.float64), np.asarray(new, bool)
  if generated.shape != given.shape or new.shape != generated.shape[:1]:
    raise ValueError(f"got joints of shapes {generated.shape} and {given.shape} with {new.shape} frames new or not; "
                     "expected the same frames of all")
  result = np.where(new[:, None, None], generated, given)
  stand = feet_stand(generated, fps, skeleton) | (feet_stand(given, fps, skeleton) & ~new[:, None])
  floor = floor_height(given, skeleton)
  for first, past in runs_of(new):
    body = _between(generated[first:past], _border(generated, given, new, first - 1, 1, skeleton),
                    _border(generated, given, new, past, -1, skeleton), skeleton, fps)
    result[first:past] = body
    if fix_body:
      result[first:past] = with_lengths(body, skeleton)
      result[first:past] = _lifted(_calmed(result, first, past, skeleton, fps), floor, skeleton)
      result[first:past] = _pinned(result, stand, first, past, skeleton, fps)
  return result


def in_spans(spans: Sequence[Sequence[int]], num_frames: int) -> Bool[np.ndarray, " t"]:
  """Mask (num_frames,) of the frames in the spans [(first, past), ...]. Raises ValueError for a span outside of the
  motion."""
  inside = np.zeros(num_frames, bool)
  for first, past in spans:
    if not 0 <= first < past <= num_frames:
      raise ValueError(f"got the span {first}:{past} of a motion of {num_frames} frames; expected 0 <= first < past <= "
                       f"{num_frames}")
    inside[first:past] = True
  return inside


def runs_of(flags: Bool[Array, " t"]) -> Iterator[tuple[int, int]]:
  """Spans (first, past) of the runs of True."""
  edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
  return zip(edges[::2].tolist(), edges[1::2].tolist())


def _border(generated, given, new, last, way, skeleton):
  """The Border at the kept frame `last`; way: 1 if the new frames follow it, -1 if they precede it. None beyond the
  ends of the motion."""
  if not 0 <= last < len(given):
    return None
  near = [last]
  while len(near) < _ALIGN and 0 <= near[-1] - way < len(given) and not new[near[-1] - way]:
    near.append(near[-1] - way)
  at = meeting(given[near], generated[near], skeleton)
  first, second = last + way, last + 2 * way
  shown, begin = laid(generated[near], at), laid(generated[first][None], at)[0]
  step, drift, beside = begin - shown[0], np.zeros_like(begin), []
  if 0 <= second < len(given) and new[second]:
    beside.append(laid(generated[second][None], at)[0] - begin)
  if len(near) > 1:
    beside.append(shown[0] - shown[1])
    drift = given[last] - given[near[1]] - beside[-1]
  # A step unlike both neighbouring steps is a jump between kept and generated frames.
  jump = step - np.mean(beside, axis=0) if beside else np.zeros_like(step)
  size = np.linalg.norm(jump, axis=-1, keepdims=True) * skeleton.unit
  return Border(at, given[last] - shown[0] - jump * np.maximum(1 - _USUAL_JUMP / np.maximum(size, 1e-9), 0), drift)


def _between(body, left, right, skeleton, fps):
  """The new frames (N, J, 3), aligned with the borders left and right of them; None for a border beyond the motion."""
  if left is None and right is None:
    return body
  if right is None:
    return _continued(body, left, skeleton, fps)
  if left is None:
    return _continued(body[::-1], right, skeleton, fps)[::-1]
  start, end = laid(body, left.at), laid(body, right.at)
  turn = (right.at.yaw - left.at.yaw + np.pi) % (2 * np.pi) - np.pi
  # Spread the turn over the frames in which the body moves; a difference that exceeds its path, over all frames.
  off = np.linalg.norm((_ground(end) - _ground(start))[len(body) // 2])
  pause = max(_PAUSE / skeleton.unit, off / len(body))
  travel = np.linalg.norm(np.diff(body[:, 0, [0, 2]], axis=0), axis=-1) + pause
  travel = np.pad(travel, 1, mode="edge") if len(travel) else np.ones(2)
  share = np.cumsum(travel)[:-1] / travel.sum()
  share = (share * share * (3 - 2 * share))[:, None]
  pose = np.empty_like(body)
  for i, frame in enumerate(start - _ground(start)[:, None]):
    pose[i] = laid(frame[None], Meeting(0.0, turn * share[i, 0], np.zeros(2), np.zeros(2)))[0]
  count, most = len(body), -(-len(body) // 2)  # both offsets have faded in the middle
  pose += _offsets(left, count, skeleton, fps, most) + _offsets(right, count, skeleton, fps, most)[::-1]
  ahead = _ground(start) + _detour(left, count, fps, most)
  back = _ground(end) + _detour(right, count, fps, most)[::-1]
  return pose + ((1 - share) * ahead + share * back)[:, None]


def _continued(body, border, skeleton, fps):
  """The new frames (N, J, 3), aligned with the kept frames before them."""
  body = laid(body, border.at)
  count = len(body)
  return body + _offsets(border, count, skeleton, fps, count) + _detour(border, count, fps, count)[:, None]


def _ground(body):
  """The root's path over the ground, (N, 3) with heights of 0."""
  return body[:, 0] * [1, 0, 1]


def _offsets(border, count, skeleton, fps, most):
  """Offsets (N, J, 3), fading to 0, that make poses relative to the root's ground position continue the kept ones."""
  away, drift = (x - x[0] * [1, 0, 1] for x in (border.away, border.drift))
  size = np.linalg.norm(drift, axis=-1, keepdims=True) * fps * skeleton.unit
  drift = drift * np.minimum(1, _MOST_DRIFT / np.maximum(size, 1e-9))
  width, s = _progress(count, fps, most)
  s = s[:, None, None]
  return away * (1 - 3 * s ** 2 + 2 * s ** 3) + drift * width * s * (1 - s) ** 2


def _detour(border, count, fps, most):
  """Offset (N, 3) that makes a path over the ground continue the kept frames. The difference of position stays, that of
  speed fades without an overshoot: a body that stops does not move back."""
  width, s = _progress(count, fps, most)
  s = s[:, None]
  return border.away[0] * [1, 0, 1] + border.drift[0] * [1, 0, 1] * width * (s - s ** 2 + s ** 3 / 3)


def _progress(count, fps, most):
  """(number of frames over which a difference fades, at most `most` + 1; progress 0 to 1 in each of count frames)."""
  width = min(round(_FADE * fps), most) + 1
  return width, np.minimum(np.arange(1, count + 1) / width, 1)


def _calmed(joints, first, past, skeleton, fps):
  """The new frames first..past of joints (T, J, 3) with the turning speed of bones limited to that of people.

  A limb that snaps to its new pose at a border turns there from the kept pose within the fade; elsewhere fast bones are
  smoothed.
  """
  from scipy.ndimage import maximum_filter1d
  parents = np.maximum(skeleton.parents, 0)
  bones = rot.unit(joints - joints[:, parents], 1e-9)
  for last, way, end in ((first - 1, 1, past - 1), (past, -1, first)):
    if not 0 <= last < len(joints):
      continue
    frames = last + way * np.arange(1, min(round(_FADE * fps), abs(end - last)) + 1)
    hasty = np.clip(_rates(bones[np.append(last, frames[:_HASTE])], fps).max(0) / _QUICK[0] - 1, 0, 1)
    before = last - way
    turn = bones[last] - bones[before] if 0 <= before < len(joints) else np.zeros_like(bones[last])
    k = np.arange(1, len(frames) + 1)[:, None, None]
    hold = rot.unit(bones[last] + turn * _FOLLOW * (1 - np.exp(-k / _FOLLOW)), 1e-9)
    s = k / (len(frames) + 1)
    weight = hasty[:, None] * (1 - s * s * (3 - 2 * s))
    bones[frames] = rot.unit(bones[frames] * (1 - weight) + hold * weight, 1e-9)
  rates = np.pad(_rates(bones, fps), ((1, 1), (0, 0)))
  rates = np.maximum(rates[1:], rates[:-1])
  quick = np.clip((maximum_filter1d(rates, 3, axis=0) - _QUICK[0]) / (_QUICK[1] - _QUICK[0]), 0, 1)
  quick = gaussian_filter1d(quick, 1.0, axis=0)[..., None]
  calm = rot.unit(gaussian_filter1d(bones, _CALM, axis=0, mode="nearest"), 1e-9)
  body = rot.unit(bones * (1 - quick) + calm * quick, 1e-9)[first:past] * skeleton.bone_lengths[:, None]
  result = joints[first:past].copy()
  for chain in skeleton.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      result[:, joint] = result[:, parent] + body[:, joint]
  return result


def _rates(bones, fps):
  """Turning speed (N - 1, J) of directions (N, J, 3), radians a second."""
  return np.arccos(np.clip((bones[1:] * bones[:-1]).sum(-1), -1, 1)) * fps * (np.linalg.norm(bones[1:], axis=-1) > 0.5)



def _lifted(body, floor, skeleton):
  """The new frames (N, J, 3), raised where feet would be below the floor."""
  from scipy.ndimage import maximum_filter1d
  sunk = np.maximum(floor - body[:, skeleton.left_feet + skeleton.right_feet, 1].min(1), 0)
  lift = gaussian_filter1d(maximum_filter1d(sunk, 5), 1.0, mode="constant")  # none in the neighbouring kept frames
  return body + lift[:, None, None] * [0, 1, 0]


def _pinned(joints, stand, first, past, skeleton, fps):
  """The new frames first..past of joints (T, J, 3) without sliding of the feet that stand (T, 4)."""
  start, end = max(first - _BESIDE, 0), min(past + _BESIDE, len(joints))
  near, stand = joints[start:end], stand[start:end]
  inside = np.arange(start, end)
  fixed = (inside < first) | (inside >= past)
  feet = np.array([skeleton.left_feet, skeleton.right_feet])
  points = near[:, feet]  # (n, 2 feet, ankle and toes, 3)
  # A foot that moves fast with the body does not stand, whatever its label.
  speed = np.linalg.norm(np.diff(points[..., [0, 2]], axis=0), axis=-1) * fps * skeleton.unit
  firm = (stand[1:] & stand[:-1]).reshape(-1, 2, 2) / (1 + (speed / _CARRIED) ** 4)
  moves = np.stack([_moves(points[:, side], firm[:, side], fixed, skeleton.unit) for side in range(2)], 1)
  aims = points + moves[:, :, None]
  return pin_feet(near, aims[:, :, 0], aims[:, :, 1], skeleton)[first - start:past - start]


def _moves(points, firm, fixed, unit):
  """Moves e (N, 3) over the ground of a foot at points (N, P, 3) that minimize sum firm |step of (point + e)|^2
  + ease |step of e|^2 + bend |step of step of e|^2 + pull |e|^2, where firm (N - 1, P), with e = 0 where fixed (N,).
  """
  count = len(points)
  first = np.diff(np.eye(count), axis=0)
  second = np.diff(np.eye(count), n=2, axis=0)
  matrix = first.T @ ((firm.sum(1) + _EASE)[:, None] * first) + _BEND * second.T @ second
  pushed = -first.T @ (firm[..., None] * np.diff(points, axis=0)).sum(1)
  moves, free, pull = np.zeros((count, 3)), ~fixed, np.full(count, _PULL)
  for _ in range(4):  # a foot moved farther than _FAR is pulled back
    moves[free] = np.linalg.solve((matrix + np.diag(pull))[np.ix_(free, free)], pushed[free])
    far = np.linalg.norm(moves[:, [0, 2]], axis=-1) * unit / _FAR
    pull = np.maximum(pull, _PULL + _PULL_BACK * np.clip(far - 1, 0, 1))
  return moves * [1, 0, 1]
