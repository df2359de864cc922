"""Counted actions: kicks, jumps, squats, bows and waves, repeated once more or once less, with a count in the caption.

If a body returns to its pose before an action, the action can be repeated or left out (`motion.splicing`). The caption
states how often the kinematic rules (`analysis`) find the action in the new clip.
"""
import collections
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS, sentences, spoken_of
from motion_jax.analysis.event_words import TIMES
from motion_jax.analysis.events import find_events
from motion_jax.data.augment.graph import poses_at
from motion_jax.data.augment.parts import MOST, PLAIN, new_clip, resting
from motion_jax.data.clip import Clip
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.splicing import REACH, spliced

COUNTED = ("kick", "jump", "hop", "squat", "bow", "reach-floor", "raise", "wave")
_BESIDE = ("still", "turn", "walk", "run")  # what may be done before and after it
_MOST_OFTEN = 4
_MEETS, _MEETS_RESTING = 0.05, 0.08  # metres between poses that meet (`graph.poses_at`), and of two at ease
_FADES, _FADES_RESTING = 9, 12       # frames in which what is off there fades
_SHORTEST = 10    # frames of a repetition
_LEAST = 30       # frames of a clip
_LEAD = 0.3       # seconds by which an action may begin before the rules find it, and end behind
_EDGE = 8         # frames that are kept before the first repetition and behind the last
_NUMBERS = {2: "two", 3: "three", 4: "four"}
_USES = 12        # clips that are made of one
_PEAK = 1.2, 0.01  # of the largest jerk of a clip, and metres a frame^3 more, that of what is made of it may be
_UNCOUNTABLE = re.compile(r"\b(once|twice|times|again|several|repeat\w*|many|one|two|three|four|few|and|while|over|"
                          r"walk\w*|run\w*|turn\w*|\w+s with .* each)\b|,", re.IGNORECASE)


def counted(parts, rng) -> Iterator[Clip | None]:
  """Actions done once to four times: "kicks with the right foot twice", "does three squats"."""
  ready = [part for part in parts if how_often(part.events) is not None
           and _acts(spoken_of(part.events, part.words)) == _acts(part.events)]
  by_kind: dict[str, list[int]] = {}
  for k, part in enumerate(ready):
    by_kind.setdefault(min(_acts(part.events))[0], []).append(k)
  found: dict[int, np.ndarray] = {}
  uses, number = collections.Counter[int](), 0
  while any(by_kind.values()):
    number += 1
    kinds = sorted(kind for kind, own in by_kind.items() if own)
    own = by_kind[kinds[rng.integers(len(kinds))]]  # rare kinds as often as frequent ones
    k = own[rng.integers(len(own))]
    if k not in found:
      found[k] = _cycles(ready[k])
    made = _repeated(ready[k], found[k], number, rng) if len(found[k]) else None
    uses[k] += made is not None
    if not len(found[k]) or uses[k] == _USES:
      own.remove(k)
    yield made


def how_often(events) -> int | None:
  """How often the action of the events is done: 0 if that is uncertain, None if there is no single such action."""
  acts = [event for event in events if event.kind not in _BESIDE]
  if len({(event.kind, event.side) for event in acts}) != 1 or acts[0].kind not in COUNTED:
    return None
  counts = [event.count for event in acts]
  if acts[0].kind == "wave":
    return counts[0] if len(counts) == 1 else None
  return sum(counts) if min(counts) else None


def _cycles(part):
  """(first, past, distance, whether at ease), (N, 4), of spans of frames at whose ends the poses meet."""
  joints, acts = part.joints, [event for event in part.events if event.kind not in _BESIDE]
  frames = np.arange(REACH, len(joints) - REACH)
  poses, feet, calm = poses_at(joints, frames), stands(joints)[frames], resting(joints)[frames]
  square = (poses ** 2).sum(-1)
  off = np.sqrt(np.maximum(square[:, None] + square - 2 * poses @ poses.T, 0))
  ease = calm[:, None] & calm
  fits = (off < np.where(ease, _MEETS_RESTING, _MEETS)) & (feet[:, None] == feet).all(-1)
  fits &= frames - frames[:, None] >= _SHORTEST
  first, past = min(event.start for event in acts) * FPS, max(event.end for event in acts) * FPS
  if how_often(part.events) == 1:  # all of it lies between the two
    fits &= (frames[:, None] <= first + 3) & (frames >= past - 3)
  else:
    fits &= (frames[:, None] >= first - _LEAD * FPS) & (frames <= past + _LEAD * FPS)
  one, other = np.nonzero(fits)
  return np.stack([frames[one], frames[other], off[one, other], ease[one, other]], -1)


def _repeated(part, cycles, number, rng):
  often = how_often(part.events)
  goal = int(rng.integers(1, _MOST_OFTEN + 1))
  cut = often != 1 and bool(rng.random() < 0.6)
  more = 0 if cut else max(goal - (often or 2), 1)
  length = cycles[:, 1] - cycles[:, 0]
  room = len(part.joints) - cycles[:, 1] + cycles[:, 0] if often != 1 else 2 * _EDGE  # besides the repetitions
  fits = cycles[(room + (1 if often == 1 else 0 if cut else 1) * length + more * length <= MOST)]
  if not len(fits):
    return None
  # A short way round, and one whose ends are close: of these any.
  order = np.argsort(fits[:, 1] - fits[:, 0] + 400 * fits[:, 2], kind="stable") if often == 1 else rng.permutation(
      len(fits))
  first, past, _, ease = fits[order[rng.integers(max(1, len(order) // 5))]]
  first, past, fade = int(first), int(past), _FADES_RESTING if ease else _FADES
  head = int(rng.integers(_EDGE, 31))
  joints = part.joints
  if cut:
    joints = spliced(joints, first, joints, past, fade=fade)
  for k in range(more):
    joints = spliced(joints, past + k * (past - first), part.joints, first, fade=fade)
  if often == 1:  # keep some frames before and after the action, as far as the longest clip allows
    least = (more + 1) * (past - first) + 2 * _EDGE
    head = min(head, _EDGE + (MOST - least) // 2, first)
    joints = joints[first - head:]
  joints = joints[:MOST]
  if _peak(joints) > _PEAK[0] * _peak(part.joints) + _PEAK[1]:
    return None
  events = find_events(joints, FPS)
  done = how_often(events)
  if len(joints) < _LEAST or not done or done > _MOST_OFTEN or done == often or _acts(events) != _acts(part.events):
    return None
  if often and ((done >= often) if cut else ((done - often) % more or done < often)):
    return None
  return _said(part, joints, events, often, done, number)


def _peak(joints):
  """The largest third difference of any joint, metres."""
  return np.linalg.norm(np.diff(joints, 3, axis=0), axis=-1).max() if len(joints) > 3 else 0.0


def _acts(events):
  return {(event.kind, event.side) for event in events if event.kind not in _BESIDE}


def _said(part, joints, events, often, done, number):
  merged = []
  for event in events:  # consecutive bows are one event with a count
    if merged and event.kind in COUNTED and (merged[-1].kind, merged[-1].side) == (event.kind, event.side):
      merged[-1] = merged[-1]._replace(end=event.end, count=merged[-1].count + event.count)
    elif event.kind != "still" or not merged or event.start < 1e-9 or event.end >= (len(joints) - 1.5) / FPS:
      merged.append(event)
  texts = sentences(merged, (len(joints) - 1) / FPS, key=f"{part.clip.id}{number}", subject=part.subject,
                    plain=PLAIN)
  words = ("once", "one time") if done == 1 else (TIMES[done], f"{_NUMBERS[done]} times")
  own = [text for text in part.sayings if not _UNCOUNTABLE.search(text)] if often == 1 else []
  texts += [re.sub(r"[\s.!]+$", "", text) + f" {words[k % 2]}." for k, text in enumerate(own)]
  if done == 1:
    texts += [re.sub(r"[\s.!]+$", "", text) + " once." for text in texts[:1] if not _UNCOUNTABLE.search(text)]
  else:  # a turn between two of them leaves neither counted
    texts = [text for text in texts if re.search(rf"\b({TIMES[done]}|{_NUMBERS[done]})\b", text)]
  return new_clip("count", number, joints, texts, part, f"{part.name} {done}") if texts else None
