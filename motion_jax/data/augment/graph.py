"""A motion graph of clips: frames ("doors") at which a part can be entered or left, and transitions between them.

There are three kinds of transition: similar poses with the same standing feet; the last step of a walk; the first step
of a walk (`motion.splicing`).
"""
import collections
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.describe import FPS
from motion_jax.analysis.rest import resting
from motion_jax.data.augment.parts import MOST, SHORTEST
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.motion.splicing import REACH, landings, meeting, spliced, stepped, weights

_MEETS = 0.06        # metres: largest distance of poses to be joined, root mean square with feet weighted four times
_MEETS_RESTING = 0.10  # the same of rest poses
_QUICKLY, _SLOWLY = 9, 14  # frames in which the offset fades; of rest poses
_KINDS, _DOORS = 6, 80  # sampled kinds of parts, and doors of each, for a transition
_WALKS = (40, 100)   # frames of a walk that are used in a chain


class Doors:
  """Frames at which parts may be entered, with their poses relative to the body."""

  def __init__(self, parts, rests):
    """rests: for each part, the mask of its rest poses."""
    doors = [(number, frame) for number, part in enumerate(parts) for frame in part.enter[::2]]
    self.part, self.frame = np.array(doors, int).reshape(-1, 2).T
    frames = [np.array(part.enter[::2], int) for part in parts]
    poses = [poses_at(part.joints, door_frames) for part, door_frames in zip(parts, frames) if len(door_frames)]
    feet = [stands(part.joints)[door_frames] for part, door_frames in zip(parts, frames)]
    self.poses = np.concatenate([np.zeros((0, 9 * HUMANML3D.num_joints), np.float32), *poses])
    self.feet = np.concatenate([np.zeros((0, 2), bool), *feet])
    self.calm = np.concatenate([np.zeros(0, bool), *(calm[door_frames] for calm, door_frames in zip(rests, frames))])
    self.rest = np.array([len(parts[number].joints) - frame for number, frame in doors], int)
    self._kinds = [np.flatnonzero([parts[number].name == name for number in self.part])
                   for name in sorted({part.name for part in parts})]

  def sample_doors(self, feet, rng):
    """Indices of random doors of a few kinds of parts at which these feet stand."""
    kinds = rng.permutation(len(self._kinds))[:_KINDS]
    doors = np.concatenate([rng.permutation(self._kinds[kind])[:_DOORS] for kind in kinds])
    return doors[(self.feet[doors] == feet).all(-1)]

  def distances(self, doors, pose):
    """Distances, metres, of the poses at these doors from a pose."""
    return np.sqrt(((self.poses[doors] - pose) ** 2).sum(-1))


class Chain(NamedTuple):
  """Parts joined in sequence: joints (T, 22, 3), the first frame of each part but the first, indices of the parts, and
  the offset, in frames, of the last part's time axis."""
  joints: np.ndarray
  borders: tuple[int, ...]
  parts: tuple[int, ...]
  offset: int


class Graph:
  """Parts and the transitions between them."""

  def __init__(self, parts):
    self.parts = parts
    self.rests = [resting(part.joints, FPS) for part in parts]
    self.into = Doors(parts, self.rests)
    self.rest_in, self.rest_out, self.stops, self.starts = {}, {}, {}, {}
    for number, part in enumerate(parts):
      before = [frame for frame in part.enter if self.rests[number][frame]]
      behind = [frame for frame in part.leave if self.rests[number][frame]]
      if before:
        self.rest_in[number] = before[0]
      if behind:
        self.rest_out[number] = behind[-1]
      if part.going and part.events[0].kind == "walk" and part.events[0].way == "forward":
        last = len(part.joints) - 1
        stops = [at for at in landings(part.joints) if at[0] in part.leave]
        starts = [(last - frame, side) for frame, side in landings(part.joints[::-1]) if last - frame in part.enter]
        self.stops |= {number: stops} if stops else {}
        self.starts |= {number: starts} if starts else {}

  def begin(self, number) -> Chain:
    return Chain(self.parts[number].joints, (), (number,), 0)

  def follow(self, chain, rng, wanted=None) -> Chain | None:
    """The chain with one more part, or None if none fits. wanted: indices of the parts that may follow."""
    last = chain.parts[-1]
    allowed = lambda number: number not in chain.parts and self.parts[number].name != self.parts[last].name and (
        wanted is None or number in wanted)
    ways = [self._meet]
    if last in self.stops:
      ways = [self._stop, self._stop, self._meet]
    elif last in self.rest_out and self.starts:
      ways = [self._start, self._meet, self._meet]
    return ways[rng.integers(len(ways))](chain, last, allowed, rng)

  def _meet(self, chain, last, allowed, rng):
    part = self.parts[last]
    since = (chain.borders or (0,))[-1] + SHORTEST // 2
    frames = [frame for frame in part.leave if since <= frame + chain.offset < len(chain.joints) - REACH]
    if not frames:
      return None
    leave = frames[rng.integers(len(frames))]
    cut, room = self._room(chain, part, leave + chain.offset, rng)
    doors = self.into.sample_doors(stands(part.joints)[leave], rng)
    off = self.into.distances(doors, poses_at(part.joints, np.array([leave]))[0])
    calm = self.into.calm[doors] & self.rests[last][leave]
    fits = [(number, door, far) for number, door, far, near in zip(
        self.into.part[doors].tolist(), doors.tolist(), off, np.where(calm, _MEETS_RESTING, _MEETS))
            if far < near and (self.parts[number].going or self.into.rest[door] <= room) and allowed(number)]
    number = self._pick({number for number, _, _ in fits}, rng)
    if number is None:
      return None
    door = min((far, door) for other, door, far in fits if other == number)[1]
    then = self.parts[number]
    leave, enter, far = best_near(chain.joints, leave + chain.offset, then.joints, int(self.into.frame[door]))
    calm = bool(self.into.calm[door] and self.rests[last][leave - chain.offset])
    if far > (_MEETS_RESTING if calm else _MEETS):
      return None
    rest = then.joints[:self._kept(then, enter, room, rng)]
    joints = spliced(chain.joints[cut:], leave - cut, rest, enter, fade=_SLOWLY if calm else _QUICKLY)
    return _longer(chain, joints, leave, enter, number, cut)

  def _stop(self, chain, last, allowed, rng):
    soonest = (chain.borders or (0,))[-1] + SHORTEST
    stops = [(frame + chain.offset, side) for frame, side in self.stops[last]
             if soonest < frame + chain.offset < len(chain.joints)]
    if not stops:
      return None
    leave, side = stops[rng.integers(len(stops))]
    cut, room = self._room(chain, self.parts[last], leave, rng)
    number = self._pick([k for k, enter in self.rest_in.items()
                         if allowed(k) and len(self.parts[k].joints) - enter <= room], rng)
    if number is None:
      return None
    enter = self.rest_in[number]
    joints = stepped(chain.joints[cut:], leave - cut, self.parts[number].joints, enter, side)
    return _longer(chain, joints, leave, enter, number, cut)

  def _start(self, chain, last, allowed, rng):
    leave = self.rest_out[last] + chain.offset
    cut, room = self._room(chain, self.parts[last], leave, rng)
    number = self._pick([k for k in self.starts if allowed(k)], rng)
    if number is None or leave >= len(chain.joints) or room < SHORTEST:
      return None
    enter, side = self.starts[number][rng.integers(len(self.starts[number]))]
    then = self.parts[number].joints[:self._kept(self.parts[number], enter, room, rng)]
    before = chain.joints[cut:]
    joints = stepped(then[::-1], len(then) - 1 - enter, before[::-1], len(before) - 1 - (leave - cut), side)[::-1]
    return _longer(chain, joints, leave - 1, enter - 1, number, cut)

  def _pick(self, numbers, rng):
    """One of these parts, all kinds with equal probability; None if there are none."""
    by_name = collections.defaultdict(list)
    for number in sorted(numbers):
      by_name[self.parts[number].name].append(number)
    if not by_name:
      return None
    candidates = by_name[sorted(by_name)[rng.integers(len(by_name))]]
    return candidates[rng.integers(len(candidates))]

  def _room(self, chain, part, leave, rng):
    """(first frame to keep, number of frames that may follow) of a chain left at a frame; an initial walk is shortened
    to a few seconds."""
    cut = max(0, leave - int(rng.integers(*_WALKS))) if part.going and not chain.borders else 0
    return cut, MOST - (leave + 1 - cut)

  def _kept(self, part, enter, room, rng):
    """End of a part that is entered at a frame; a walk is limited to a few seconds."""
    return min(len(part.joints), enter + min(room, int(rng.integers(*_WALKS)))) if part.going else len(part.joints)


def _longer(chain, joints, leave, enter, number, cut):
  """The chain `joints` after dropping `cut` frames and joining frame `enter` of a part to frame `leave`."""
  return Chain(joints, (*(border - cut for border in chain.borders), leave + 1 - cut), (*chain.parts, number),
               leave - enter - cut)


def best_near(first, leave, second, enter, reach=1):
  """(leave, enter, distance): the best frames, within `reach` of the given ones, at which to join two motions."""
  window = lambda joints, frame: joints[frame - REACH:frame + REACH + 1]
  candidates = []
  for i in range(max(leave - reach, REACH), min(leave + reach + 1, len(first) - REACH)):
    for j in range(max(enter - reach, REACH), min(enter + reach + 1, len(second) - REACH)):
      candidates.append((meeting(window(first, i), window(second, j)).distance, i, j))
  distance, i, j = min(candidates, default=(np.inf, leave, enter))
  return i, j, distance


def poses_at(joints, frames) -> np.ndarray:
  """Joints before, at and after frames (N,), relative to the body's position and heading: (N, 198) float32, weighted:
  Euclidean distances are root mean squares in metres."""
  ahead, root = facing(joints)[frames], joints[frames, 0] * [1, 0, 1]
  weight = np.sqrt(np.tile(weights(HUMANML3D), 3) / 3)[:, None]
  window = np.concatenate([joints[frames + shift] for shift in (-REACH, 0, REACH)], 1) - root[:, None]
  sin, cos = ahead[:, None, 0], ahead[:, None, 2]
  x, y, z = np.moveaxis(window, -1, 0)
  turned = np.stack([x * cos - z * sin, y, x * sin + z * cos], -1)
  return (turned * weight).reshape(len(frames), -1).astype(np.float32)
