"""Where clips may go on as one another: doors at which a part is entered or left, and which of them fit.

Three ways lead from one to the next: where the poses around two doors meet and the same feet stand; by the step with
which a walk comes to rest; by the step with which it begins (`motion.splicing`).
"""
from typing import NamedTuple

import numpy as np

from motion_jax.data.augment.parts import MOST, SHORTEST, resting
from motion_jax.motion.planting import stands
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.motion.splicing import REACH, landings, meeting, spliced, stepped, weights

_MEETS = 0.06        # metres, root mean square with feet four times: poses that meet
_MEETS_RESTING = 0.10  # of two that stand at ease: there is time to change from one to the other
_SLOWLY = 14         # frames for that
_WALKS = (40, 100)   # frames that a walk keeps as a part of others


class Doors:
  """Frames at which parts may be entered, or left, with the poses around them in their own frame of reference."""

  def __init__(self, parts, frames_of):
    """frames_of(part) -> frames."""
    found = [(number, frame) for number, part in enumerate(parts) for frame in frames_of(part)]
    self.part, self.frame = np.array(found, int).reshape(-1, 2).T
    poses = [poses_at(part.joints, np.array(frames_of(part))) for part in parts if len(frames_of(part))]
    feet = [stands(part.joints)[list(frames_of(part))] for part in parts if len(frames_of(part))]
    self.poses = np.concatenate(poses) if poses else np.zeros((0, 1), np.float32)
    self.feet = np.concatenate(feet) if feet else np.zeros((0, 2), bool)
    self._squares = (self.poses ** 2).sum(-1)

  def distances(self, pose, feet):
    """(N,) metres from the poses of each door to others; infinite where other feet stand."""
    squares = np.maximum(self._squares - 2 * self.poses @ pose + (pose ** 2).sum(), 0)
    return np.where((self.feet == feet).all(-1), np.sqrt(squares), np.inf)


class Chain(NamedTuple):
  """Parts joined one after the other: joints (T, 22, 3), the first frame of each but the first, their numbers, and how
  many frames later than by itself the last part plays."""
  joints: np.ndarray
  borders: tuple[int, ...]
  parts: tuple[int, ...]
  offset: int


class Graph:
  """Parts and the ways between them."""

  def __init__(self, parts):
    self.parts = parts
    self.into = Doors(parts, lambda part: part.enter[::2])
    self.rests = [resting(part.joints) for part in parts]
    self.rest_in, self.rest_out, self.stops, self.starts = {}, {}, {}, {}
    for number, part in enumerate(parts):
      walks = part.going and part.events[0].kind == "walk" and part.events[0].way == "forward"
      before = [frame for frame in part.enter if self.rests[number][frame]]
      behind = [frame for frame in part.leave if self.rests[number][frame]]
      if before:
        self.rest_in[number] = before[0]
      if behind:
        self.rest_out[number] = behind[-1]
      stops = [at for at in landings(part.joints) if at[0] in part.leave] if walks else []
      starts = [at for at in landings(part.joints[::-1]) if len(part.joints) - 1 - at[0] in part.enter] if walks else []
      if stops:
        self.stops[number] = stops
      if starts:
        self.starts[number] = starts

  def begin(self, number) -> Chain:
    return Chain(self.parts[number].joints, (), (number,), 0)

  def follow(self, chain, rng, wanted=None) -> Chain | None:
    """The chain with one more part, or None where nothing fits. wanted: numbers of parts that may follow."""
    last = chain.parts[-1]
    allowed = lambda number: number not in chain.parts and self.parts[number].name != self.parts[last].name and (
        wanted is None or number in wanted)
    ways = [self._meet]
    if last in self.stops:
      ways = [self._stop, self._stop, self._meet]
    elif last in self.rest_out and self.starts:
      ways = [self._start, self._meet, self._meet]
    found = ways[rng.integers(len(ways))](chain, last, allowed, rng)
    return found if found is not None and len(found.joints) <= MOST else None

  def _pick(self, numbers, rng):
    """One of these parts, rare ones as often as frequent ones; None of none."""
    names = sorted({self.parts[number].name for number in numbers})
    if not names:
      return None
    name = names[rng.integers(len(names))]
    numbers = [number for number in numbers if self.parts[number].name == name]
    return numbers[rng.integers(len(numbers))]

  def _meet(self, chain, last, allowed, rng):
    part = self.parts[last]
    since = chain.borders[-1] + SHORTEST // 2 if chain.borders else SHORTEST // 2
    frames = [frame for frame in part.leave if since <= frame + chain.offset < len(chain.joints) - REACH]
    if not frames:
      return None
    leave = frames[rng.integers(len(frames))]
    rests = bool(self.rests[last][leave])
    feet = stands(part.joints)[leave]
    distance = self.into.distances(poses_at(part.joints, np.array([leave]))[0], feet)
    calm = np.array([self.rests[k][f] for k, f in zip(self.into.part, self.into.frame)], bool) & rests
    fits = np.flatnonzero(distance < np.where(calm, _MEETS_RESTING, _MEETS))
    number = self._pick([k for k in dict.fromkeys(self.into.part[fits].tolist()) if allowed(k)], rng)
    if number is None:
      return None
    own = fits[self.into.part[fits] == number]
    enter = int(self.into.frame[own[distance[own].argmin()]])
    then = self.parts[number]
    leave, enter, off = best_near(chain.joints, leave + chain.offset, then.joints, enter)
    calm = rests and bool(self.rests[number][enter])
    if off > (_MEETS_RESTING if calm else _MEETS):
      return None
    keep = self._kept(then, enter, rng)
    joints = spliced(chain.joints, leave, then.joints[:keep], enter, fade=_SLOWLY if calm else 9)
    return self._longer(chain, joints, leave, enter, number, part, rng)

  def _stop(self, chain, last, allowed, rng):
    number = self._pick([k for k in self.rest_in if allowed(k)], rng)
    soonest = (chain.borders or (0,))[-1] + SHORTEST
    stops = [(frame + chain.offset, side) for frame, side in self.stops[last]
             if soonest < frame + chain.offset < len(chain.joints)]
    if number is None or not stops:
      return None
    leave, side = stops[rng.integers(len(stops))]
    enter, then = self.rest_in[number], self.parts[number]
    joints = stepped(chain.joints, leave, then.joints[:self._kept(then, enter, rng)], enter, side)
    return self._longer(chain, joints, leave, enter, number, self.parts[last], rng)

  def _start(self, chain, last, allowed, rng):
    number = self._pick([k for k in self.starts if allowed(k)], rng)
    if number is None:
      return None
    leave = self.rest_out[last] + chain.offset
    if leave >= len(chain.joints):
      return None
    then, starts = self.parts[number].joints, self.starts[number]
    back, side = starts[rng.integers(len(starts))]
    enter = len(then) - 1 - back
    then = then[:self._kept(self.parts[number], enter, rng)]
    joints = stepped(then[::-1], len(then) - 1 - enter, chain.joints[::-1], len(chain.joints) - 1 - leave, side)[::-1]
    # The step is taken at the expense of the standing: as many frames as there are.
    return self._longer(chain, joints, leave - 1, enter - 1, number, self.parts[last], rng)

  def _kept(self, part, enter, rng):
    """Where a part that is entered there ends: of a walk only some seconds are taken."""
    return min(len(part.joints), enter + int(rng.integers(*_WALKS))) if part.going else len(part.joints)

  def _longer(self, chain, joints, leave, enter, number, part, rng):
    """The chain with `joints`, a part that is entered at frame `enter` behind frame `leave`."""
    cut = 0
    if not chain.borders and part.going:  # of a walk at the beginning only some seconds are taken
      cut = max(0, leave - int(rng.integers(*_WALKS)))
    return Chain(joints[cut:], (*(border - cut for border in chain.borders), leave + 1 - cut),
                 (*chain.parts, number), leave - enter - cut)


def best_near(first, leave, second, enter, reach=2):
  """(leave, enter, distance) of the frames within `reach` of these at which two motions meet best."""
  window = lambda joints, frame: joints[frame - REACH:frame + REACH + 1]
  found = []
  for i in range(max(leave - reach, REACH), min(leave + reach + 1, len(first) - REACH)):
    for j in range(max(enter - reach, REACH), min(enter + reach + 1, len(second) - REACH)):
      found.append((meeting(window(first, i), window(second, j)).distance, i, j))
  distance, i, j = min(found, default=(np.inf, leave, enter))
  return i, j, distance


def poses_at(joints, frames) -> np.ndarray:
  """Joints before, at and after frames (N,), the heading and the place of these taken out: (N, 198) float32, weighted
  so that Euclidean distances are root mean squares in metres."""
  ahead, root = facing(joints)[frames], joints[frames, 0] * [1, 0, 1]
  weight = np.sqrt(np.tile(weights(HUMANML3D), 3) / 3)[:, None]
  window = np.concatenate([joints[frames + shift] for shift in (-REACH, 0, REACH)], 1) - root[:, None]
  sin, cos = ahead[:, None, 0], ahead[:, None, 2]
  x, y, z = np.moveaxis(window, -1, 0)
  turned = np.stack([x * cos - z * sin, y, x * sin + z * cos], -1)
  return (turned * weight).reshape(len(frames), -1).astype(np.float32)
