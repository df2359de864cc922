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
from motion_jax.analysis.rest import resting
from motion_jax.data.augment.graph import poses_at
from motion_jax.data.augment.parts import MOST, PLAIN, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.splicing import REACH, spliced

COUNTED = ("kick", "jump", "hop", "squat", "bow", "reach-floor", "raise", "wave")
_BESIDE = ("still", "turn", "walk", "run")  # other actions that a clip may contain
_MOST_OFTEN = 4
_MEETS, _MEETS_RESTING = 0.05, 0.08  # metres: largest distance of poses to be joined (`graph.poses_at`); of rest poses
_FADES, _FADES_RESTING = 9, 12       # frames in which their offset fades
_SHORTEST = 10    # frames of a repetition
_LEAST = 30       # frames of a clip
_LEAD = 0.3       # seconds of an action before and after its detected span
_EDGE = 8         # frames kept before the first repetition and after the last
_NUMBERS = {2: "two", 3: "three", 4: "four"}
_USES = 12        # new clips per source clip
_PEAK = 1.2, 0.01  # largest jerk of a new clip: factor of its source clip's, and metres per frame^3 more
_UNCOUNTABLE = re.compile(r"\b(once|twice|times|again|several|repeat\w*|many|one|two|three|four|few|and|while|over|"
                          r"walk\w*|run\w*|turn\w*|\w+s with .* each)\b|,", re.IGNORECASE)


def counted(parts, rng) -> Iterator[Clip | None]:
  """Actions performed once to four times: "kicks with the right foot twice", "does three squats"."""
  ready = [part for part in parts if how_often(part.events) is not None
           and _acts(spoken_of(part.events, part.words)) == _acts(part.events)]
  by_kind: dict[str, list[int]] = {}
  for k, part in enumerate(ready):
    by_kind.setdefault(min(_acts(part.events))[0], []).append(k)
  cycles_of: dict[int, np.ndarray] = {}
  uses, number = collections.Counter[int](), 0
  while any(by_kind.values()):
    number += 1
    kinds = sorted(kind for kind, members in by_kind.items() if members)
    members = by_kind[kinds[rng.integers(len(kinds))]]  # rare kinds as often as frequent ones
    k = members[rng.integers(len(members))]
    if k not in cycles_of:
      cycles_of[k] = _cycles(ready[k])
    clip = _repeated(ready[k], cycles_of[k], number, rng) if len(cycles_of[k]) else None
    uses[k] += clip is not None
    if not len(cycles_of[k]) or uses[k] == _USES:
      members.remove(k)
    yield clip


def how_often(events) -> int | None:
  """Number of repetitions of the action in the events: 0 if uncertain, None if there is no single countable action."""
  acts = [event for event in events if event.kind not in _BESIDE]
  if len({(event.kind, event.side) for event in acts}) != 1 or acts[0].kind not in COUNTED:
    return None
  counts = [event.count for event in acts]
  if acts[0].kind == "wave":
    return counts[0] if len(counts) == 1 else None
  return sum(counts) if min(counts) else None


def _cycles(part):
  """Spans of frames with similar poses at both ends: (first, past, distance, whether rest poses), (N, 4)."""
  joints, acts = part.joints, [event for event in part.events if event.kind not in _BESIDE]
  frames = np.arange(REACH, len(joints) - REACH)
  poses, feet, calm = poses_at(joints, frames), stands(joints)[frames], resting(joints, FPS)[frames]
  square = (poses ** 2).sum(-1)
  off = np.sqrt(np.maximum(square[:, None] + square - 2 * poses @ poses.T, 0))
  ease = calm[:, None] & calm
  fits = (off < np.where(ease, _MEETS_RESTING, _MEETS)) & (feet[:, None] == feet).all(-1)
  fits &= frames - frames[:, None] >= _SHORTEST
  first, past = min(event.start for event in acts) * FPS, max(event.end for event in acts) * FPS
  if how_often(part.events) == 1:  # the whole action lies in the span
    fits &= (frames[:, None] <= first + 3) & (frames >= past - 3)
  else:
    fits &= (frames[:, None] >= first - _LEAD * FPS) & (frames <= past + _LEAD * FPS)
  start, end = np.nonzero(fits)
  return np.stack([frames[start], frames[end], off[start, end], ease[start, end]], -1)


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
  # Any of the shortest spans with the closest ends.
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
  """Largest third difference (jerk) of any joint, metres per frame^3."""
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
  plain_texts = [text for text in part.sayings if not _UNCOUNTABLE.search(text)] if often == 1 else []
  texts += [re.sub(r"[\s.!]+$", "", text) + f" {words[k % 2]}." for k, text in enumerate(plain_texts)]
  if done == 1:
    texts += [re.sub(r"[\s.!]+$", "", text) + " once." for text in texts[:1] if not _UNCOUNTABLE.search(text)]
  else:  # keep captions that state the count: a turn between two repetitions leaves them uncounted
    texts = [text for text in texts if re.search(rf"\b({TIMES[done]}|{_NUMBERS[done]})\b", text)]
  return new_clip("count", number, joints, texts, part, f"{part.name} {done}") if texts else None
