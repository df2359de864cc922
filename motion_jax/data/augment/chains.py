"""Join clips: pairs and triples of actions ("stitched"), and standing still before or after an action ("idle")."""
import re
from collections.abc import Iterator

from motion_jax.analysis.describe import FPS
from motion_jax.analysis.events import find_events
from motion_jax.analysis.rest import resting
from motion_jax.data.augment.graph import Chain, Graph
from motion_jax.data.augment.parts import Part, new_clip
from motion_jax.data.clip import Caption, Clip
from motion_jax.motion.splicing import REACH, spliced
from motion_jax.text.captions import SUBJECTS, without_subject

_THREE = 0.3          # share of stitched clips with three parts
_STANDS = (24, 60)    # frames of standing
_SHORTEST = 40        # frames of standing alone
_ALONE = 0.1          # share of idle clips that show standing only, which no archive has
_STILL = ("stands still", "stands in place", "is standing still", "stands still and does not move", "does not move")
STAND = "stand still"  # content of standing parts


def stitched(parts, rng) -> Iterator[Clip | None]:
  """Two or three parts in sequence, with captions like "A, then B and finally C", and spans."""
  graph = Graph(_sayable(parts))
  starts = sorted({part.name for part in graph.parts})
  number = 0
  while len(starts) > 1:
    number += 1
    name = starts[rng.integers(len(starts))]
    starts_of_kind = [k for k, part in enumerate(graph.parts) if part.name == name]
    chain = graph.begin(starts_of_kind[rng.integers(len(starts_of_kind))])
    for _ in range(2 if rng.random() < _THREE else 1):
      chain = graph.follow(chain, rng) or chain
    yield _sequence(graph, chain, number, rng)


def idle(parts, rng) -> Iterator[Clip | None]:
  """An action after standing, or standing after it, or both: "stands still, then ..."; or standing alone."""
  still = [still_part for part in parts for still_part in standing(part)]
  known = _sayable(parts)
  graph = Graph([*known, *still])
  actions, stands = range(len(known)), range(len(known), len(known) + len(still))
  names = sorted({part.name for part in known})
  number = 0
  while known and still:
    number += 1
    if rng.random() < _ALONE:
      yield _standing_alone(still[rng.integers(len(still))], number, rng)
      continue
    first = bool(rng.random() < 0.5)
    choices = stands
    if not first:
      name = names[rng.integers(len(names))]
      choices = [k for k, part in enumerate(known) if part.name == name]
    chain: Chain | None = graph.begin(choices[rng.integers(len(choices))])
    chain = graph.follow(chain, rng, actions if first else stands)
    if chain is not None and first and rng.random() < 0.4:
      chain = graph.follow(chain, rng, stands) or chain
    yield None if chain is None else _with_standing(graph, chain, number, rng)


def standing(part, least=_STANDS[1]) -> list[Part]:
  """Spans in which a body stands still with its arms down, as parts, extended to at least `least` frames."""
  parts, rests = [], resting(part.joints, FPS)
  for event in part.events:
    first, past = round(event.start * FPS), round(event.end * FPS)
    joints = part.joints[first:past]
    if event.kind != "still" or not rests[first:past].all() or len(joints) < 2 * REACH + 6:
      continue
    while len(joints) < least:  # repeat the span; the small offset fades
      joints = spliced(joints, len(joints) - 1 - REACH, part.joints[first:past], REACH)
    doors = range(REACH, len(joints) - REACH)
    clip = part.clip.replace(joints=joints, captions=(Caption("a person stands still."),), meta={"content": STAND})
    parts.append(Part(clip, joints, (event,), False, doors[:_STANDS[1] - _STANDS[0]], doors[_STANDS[0]:], ()))
  return parts


def _standing_alone(part, number, rng):
  """A random cut of a standing part, with random captions of it."""
  length = int(rng.integers(_SHORTEST, len(part.joints) + 1))
  start = int(rng.integers(len(part.joints) - length + 1))
  said = [f"{SUBJECTS[number % len(SUBJECTS)]} {_STILL[k]}." for k in rng.permutation(len(_STILL))[:3]]
  return new_clip("idle", number, part.joints[start:start + length], said, part, STAND)


def _sayable(parts):
  """Parts with a complete action and captions that can be combined with others."""
  return [part for part in parts if part.sayings and part.known and (part.going or part.clip.meta.get("whole", True))]


def _shows(chain, parts) -> bool:
  """Whether the rules detect in each part the events of its source clip, and standing of at least 0.7 s."""
  events, borders = find_events(chain.joints, FPS), [0, *chain.borders, len(chain.joints)]
  for part, first, past in zip(parts, borders[:-1], borders[1:]):
    inside = {event.kind for event in events if event.start * FPS < past and event.end * FPS > first
              and (event.kind != "still" or event.end - event.start > 0.7)}
    wanted = {event.kind for event in part.events if event.kind != "still" or part.name == STAND}
    if not wanted <= inside:
      return False
  return True


def _sequence(graph, chain, number, rng):
  parts = [graph.parts[k] for k in chain.parts]
  if len(parts) < 2 or not _shows(chain, parts):
    return None
  said, texts = [], []
  for variant in range(3):
    texts = [part.sayings[rng.integers(len(part.sayings))] for part in parts]
    said.append(in_a_row(texts, variant))
  borders = [0, *chain.borders, len(chain.joints)]
  spans = list(zip(texts, borders[:-1], borders[1:]))
  return new_clip("stitched", number, chain.joints, said, parts[0], parts[0].name, spans)


def _with_standing(graph, chain, number, rng):
  parts = [graph.parts[k] for k in chain.parts]
  borders = [0, *chain.borders, len(chain.joints)]
  if not _shows(chain, parts):
    return None
  said, texts = [], []
  for variant in range(3):
    texts = []
    for place, part in enumerate(parts):
      subject = f"{SUBJECTS[variant]} "
      if part.name != STAND:
        texts.append(part.sayings[rng.integers(len(part.sayings))])
      elif place and parts[place - 1].going:
        texts.append(subject + ("stops and stands still", "stops", "comes to a stop and stands still")[variant])
      else:
        texts.append(subject + ("stands still", "stands still for a moment", "stands in place")[variant])
    said.append(in_a_row(texts, variant))
  action = next(part for part in parts if part.name != STAND)
  spans = list(zip(texts, borders[:-1], borders[1:]))
  return new_clip("idle", number, chain.joints, said, action, action.name, spans)


def in_a_row(texts, variant) -> str:
  """Joins two or three sentences of one subject: "A, then B and finally C."."""
  first, *others = [re.sub(r"[\s.!]+$", "", text) for text in texts]
  others = [without_subject(text) for text in others]
  if len(others) == 1:
    return first + (", then ", " and then ", ", and after that ")[variant % 3] + others[0] + "."
  middle, last = ((", then ", " and finally "), (", then ", ", then "), (", then ", " and then "))[variant % 3]
  return first + middle + others[0] + last + others[1] + "."
