"""Short cuts around what is done in a longer clip: "punches with the right hand", where a clip of boxing is long.

A clip of eight seconds in which a fist flies out three times teaches little of what a punch is; of an excerpt what a
sentence names is the most. What is said of it is what the rules that describe motion find in it.
"""
import collections
from collections.abc import Iterator

from motion_jax.data.augment.counted import how_often
from motion_jax.data.augment.parts import new_clip
from motion_jax.data.clip import Clip
from motion_jax.data.describe import FPS, sentences, spoken_of
from motion_jax.motion.events import find_events

_ACTS = ("kick", "punch", "jump", "hop", "squat", "bow", "raise", "wave", "reach-floor")
_LEAD = (0.3, 1.0)   # seconds before the first and behind the last act
_SHORTEST = 30       # frames of an excerpt
_SHARE = 0.9         # of its clip that an excerpt is at most: a longer one is the clip
_USES = 6            # excerpts of one clip


def excerpts(parts, rng) -> Iterator[Clip | None]:
  """Cuts around one act of a clip, or several of one kind in a row."""
  ready = [(part, acts) for part in parts if (acts := _acts_of(part))]
  by_kind: dict[str, list[int]] = {}
  for k, (_, acts) in enumerate(ready):
    for kind in {act.kind for act in acts}:
      by_kind.setdefault(kind, []).append(k)
  uses, number = collections.Counter[tuple[str, int]](), 0
  while any(by_kind.values()):
    number += 1
    kinds = sorted(kind for kind, own in by_kind.items() if own)
    kind = kinds[rng.integers(len(kinds))]  # rare kinds as often as frequent ones
    k = by_kind[kind][rng.integers(len(by_kind[kind]))]
    uses[kind, k] += 1
    if uses[kind, k] == _USES:
      by_kind[kind].remove(k)
    part, acts = ready[k]
    yield _cut(part, acts, kind, number, rng)


def _acts_of(part):
  """What is done in a clip, as far as its captions speak of it."""
  return [event for event in spoken_of(part.events, part.words) if event.kind in _ACTS]


def _cut(part, acts, kind, number, rng):
  own = [place for place, act in enumerate(acts) if act.kind == kind]
  place = own[rng.integers(len(own))]
  act, others = acts[place], [other for other in part.events if other.kind in _ACTS and other is not acts[place]]
  before, behind = (float(rng.uniform(*_LEAD)) for _ in range(2))
  # Nothing else that is done is cut in two.
  first = max([act.start - before, *(other.end for other in others if other.end <= act.start)])
  past = min([act.end + behind, *(other.start for other in others if other.start >= act.end)])
  begin, end = max(round(first * FPS), 0), min(round(past * FPS) + 1, len(part.joints))
  if any(other.start < past and other.end > first for other in others) or not (
      _SHORTEST <= end - begin <= _SHARE * len(part.joints)):
    return None
  joints = part.joints[begin:end]
  events = find_events(joints, FPS)
  found = [event for event in events if event.kind in _ACTS]
  if [(event.kind, event.side, event.count) for event in found] != [(act.kind, act.side, act.count)]:
    return None
  texts = sentences(found, (len(joints) - 1) / FPS, key=f"{part.clip.id}{number}")
  often = how_often(found)
  return new_clip("excerpt", number, joints, texts, part, f"{kind} {act.side} {often or ''}".strip()) if texts else None
