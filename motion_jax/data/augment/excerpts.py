"""Short excerpts around one action of a longer clip: "punches with the right hand" out of a long clip of boxing.

Three punches in a clip of eight seconds teach a model little about a punch; most frames of an excerpt show the action
of its caption. Captions state the events that the kinematic rules (`analysis`) detect in the excerpt.
"""
import collections
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS, sentences, spoken_of
from motion_jax.analysis.events import find_events
from motion_jax.analysis.rest import resting
from motion_jax.analysis.signals import Body
from motion_jax.data.augment.counted import how_often
from motion_jax.data.augment.parts import MOST, new_clip
from motion_jax.data.clip import Clip

_ACTS = ("kick", "punch", "jump", "hop", "squat", "bow", "raise", "wave", "reach-floor")
_AROUND = (150, 210)  # degrees of a turn that counts as turning around
_TURNS = ("a person turns around to the {side}.", "someone turns around.", "a person turns around on the spot.",
          "the person turns 180 degrees to the {side}.")
_FIGHTS = re.compile(r"kick|punch|box|karate|geri", re.IGNORECASE)  # clips with intended kicks and punches
_ROUGH = re.compile(r"playground|climb|uneven|terrain|ladder|stool|Unknown")  # clips in which some rules are unreliable
_LEAD = (0.3, 1.0)   # seconds of context before and after an event
_REST = 1.6          # seconds of context in which to search for a rest pose
_SHORTEST = 30       # frames of an excerpt
_SHARE = 0.9         # largest share of its clip that an excerpt may be
_USES, _TRIES = 6, 18  # excerpts of one clip and kind, and attempts at them


def excerpts(parts, rng) -> Iterator[Clip | None]:
  """Cuts around one event of a clip, or several consecutive ones of one kind."""
  ready = [(part, acts) for part in parts if (acts := _acts_of(part))]
  by_kind: dict[str, list[int]] = {}
  for k, (_, acts) in enumerate(ready):
    for kind in {act.kind for act in acts}:
      by_kind.setdefault(kind, []).append(k)
  uses, tries, number = collections.Counter[tuple[str, int]](), collections.Counter[tuple[str, int]](), 0
  while any(by_kind.values()):
    number += 1
    kinds = sorted(kind for kind, members in by_kind.items() if members)
    kind = kinds[rng.integers(len(kinds))]  # rare kinds as often as frequent ones
    k = by_kind[kind][rng.integers(len(by_kind[kind]))]
    part, acts = ready[k]
    clip = _cut(part, acts, kind, number, rng)
    tries[kind, k] += 1
    uses[kind, k] += clip is not None
    if uses[kind, k] == _USES or tries[kind, k] == _TRIES:
      by_kind[kind].remove(k)
    yield clip


def _acts_of(part):
  """Events of a clip that its captions mention; also kicks and punches of fighting clips, sideways walks, and turns in
  place by half a circle, which captions seldom mention."""
  said = [event for event in spoken_of(part.events, part.words) if event.kind in _ACTS]
  if _ROUGH.search(part.words):
    return said
  walks = [event for event in part.events if event.kind in ("walk", "run")]
  return [event for event in part.events if event in said
          or event.kind in ("kick", "punch") and _FIGHTS.search(part.words)
          or part.known and not _FIGHTS.search(part.words) and _goes_sideways(event)
          or _turns_around(event) and not any(walk.start < event.end and walk.end > event.start for walk in walks)]


def _goes_sideways(event):
  return event.kind == "walk" and event.way in ("left", "right")


def _turns_around(event):
  return event.kind == "turn" and _AROUND[0] <= abs(event.amount) <= _AROUND[1]


def _net_turn(joints):
  heading = Body(joints, FPS).heading
  return np.degrees(heading[-1] - heading[0])


def _lead(frames, rests, rng):
  """Number of frames of context before or after an event, ending at a rest pose if there is one.

  frames: available frames; rests: whether each is a rest pose, the nearest frame first.
  """
  soonest = round(_LEAD[0] * FPS)
  calm = np.flatnonzero(rests[soonest:round(_REST * FPS)]) + soonest
  calm = calm[calm < frames]
  return int(calm[rng.integers(len(calm))]) + 1 if len(calm) else min(round(float(rng.uniform(*_LEAD)) * FPS), frames)


def _cut(part, acts, kind, number, rng):
  candidates = [place for place, act in enumerate(acts) if act.kind == kind]
  place = candidates[rng.integers(len(candidates))]
  act = acts[place]
  others = [other for other in part.events if (other.kind in _ACTS or _turns_around(other)) and other != act]
  # No other event is cut in two.
  first = max([0.0, *(other.end for other in others if other.end <= act.start)])
  past = min([len(part.joints) / FPS, *(other.start for other in others if other.start >= act.end)])
  start, stop, rests = round(act.start * FPS), round(act.end * FPS) + 1, resting(part.joints, FPS)
  begin = start - _lead(start - round(first * FPS), rests[:start][::-1], rng)
  end = min(stop + _lead(max(round(past * FPS) - stop, 0), rests[stop:], rng), len(part.joints))
  first, past = begin / FPS, end / FPS
  if any(other.start < past and other.end > first for other in others) or not (
      _SHORTEST <= end - begin <= min(_SHARE * len(part.joints), MOST)):
    return None
  joints = part.joints[begin:end]
  events = find_events(joints, FPS)
  shown = [event for event in events if event.kind in _ACTS or kind == "turn" and _turns_around(event)
           or kind == "walk" and event.kind in ("walk", "run")]
  same = ("kind", "side", "count", "way") if kind == "walk" else ("kind", "side", "count")
  if [[getattr(event, name) for name in same] for event in shown] != [[getattr(act, name) for name in same]]:
    return None
  if kind == "turn":
    around = _AROUND[0] <= abs(_net_turn(joints)) <= _AROUND[1]
    texts = [text.format(side=act.side) for text in _TURNS] if around else []
  else:
    texts = sentences(shown, (len(joints) - 1) / FPS, key=f"{part.clip.id}{number}", subject=part.subject)
  often = how_often(shown)
  path = act.path if kind == "jump" else ""
  shows = " ".join(filter(None, (kind, act.side or act.way, path, str(often or ""))))
  return new_clip("excerpt", number, joints, texts, part, shows) if texts else None
