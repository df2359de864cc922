"""Join clips: pairs and triples of actions ("stitched"), and standing still before or after an action ("idle")."""
import re
from collections.abc import Iterator

from motion_jax.analysis.describe import FPS
from motion_jax.analysis.events import find_events
from motion_jax.data.augment.graph import Chain, Graph
from motion_jax.data.augment.parts import Part, new_clip, resting
from motion_jax.data.clip import Caption, Clip
from motion_jax.motion.splicing import REACH, spliced
from motion_jax.text.captions import SUBJECTS, without_subject

_THREE = 0.3          # of stitched clips have three parts
_STANDS = (24, 60)    # frames of standing
_SHORTEST = 40        # frames of standing alone
_ALONE = 0.1          # of idle clips are standing alone, which no archive has a clip of
_STILL = ("stands still", "stands in place", "is standing still", "stands still and does not move", "does not move")
STAND = "stand still"  # what standing shows, beside the archives' own words


def stitched(parts, rng) -> Iterator[Clip | None]:
  """Two or three parts one after the other, by sentences like "A, then B and finally C", and by spans."""
  graph = Graph(_sayable(parts))
  starts = sorted({part.name for part in graph.parts})
  number = 0
  while len(starts) > 1:
    number += 1
    name = starts[rng.integers(len(starts))]
    own = [k for k, part in enumerate(graph.parts) if part.name == name]
    chain = graph.begin(own[rng.integers(len(own))])
    for _ in range(2 if rng.random() < _THREE else 1):
      chain = graph.follow(chain, rng) or chain
    yield _sequence(graph, chain, number, rng)


def idle(parts, rng) -> Iterator[Clip | None]:
  """An action after standing, or standing after it, or both: "stands still, then ..."; or standing alone."""
  still = [made for part in parts for made in standing(part)]
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
    own = stands
    if not first:
      name = names[rng.integers(len(names))]
      own = [k for k, part in enumerate(known) if part.name == name]
    chain: Chain | None = graph.begin(own[rng.integers(len(own))])
    chain = graph.follow(chain, rng, actions if first else stands)
    if chain is not None and first and rng.random() < 0.4:
      chain = graph.follow(chain, rng, stands) or chain
    yield None if chain is None else _with_standing(graph, chain, number, rng)


def standing(part, least=_STANDS[1]) -> list[Part]:
  """Spans in which a body stands still with its arms down, as parts of their own, continued to at least some frames."""
  found, rests = [], resting(part.joints)
  for event in part.events:
    first, past = round(event.start * FPS), round(event.end * FPS)
    joints = part.joints[first:past]
    if event.kind != "still" or not rests[first:past].all() or len(joints) < 2 * REACH + 6:
      continue
    while len(joints) < least:  # on from its end as from its beginning: what little it moved fades
      joints = spliced(joints, len(joints) - 1 - REACH, part.joints[first:past], REACH)
    doors = range(REACH, len(joints) - REACH)
    clip = part.clip.replace(joints=joints, captions=(Caption("a person stands still."),), meta={"content": STAND})
    found.append(Part(clip, joints, (event,), False, doors[:_STANDS[1] - _STANDS[0]], doors[_STANDS[0]:], ()))
  return found


def _standing_alone(part, number, rng):
  """A standing body, from some frame on, by some of the words for it."""
  length = int(rng.integers(_SHORTEST, len(part.joints) + 1))
  start = int(rng.integers(len(part.joints) - length + 1))
  said = [f"{SUBJECTS[number % len(SUBJECTS)]} {_STILL[k]}." for k in rng.permutation(len(_STILL))[:3]]
  return new_clip("idle", number, part.joints[start:start + length], said, part, STAND)


def _sayable(parts):
  """Parts whose action is whole and can be put in a sentence with others."""
  return [part for part in parts if part.sayings and part.known and (part.going or part.clip.meta.get("whole", True))]


def _shows(chain, parts) -> bool:
  """Whether the rules find in each part what they found in the clip that it comes from, standing for 0.7 s at least."""
  found, borders = find_events(chain.joints, FPS), [0, *chain.borders, len(chain.joints)]
  for part, first, past in zip(parts, borders[:-1], borders[1:]):
    inside = {event.kind for event in found if event.start * FPS < past and event.end * FPS > first
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
  """Sentences of one subject as one: what the first says, then what the others say is done."""
  first, *others = [re.sub(r"[\s.!]+$", "", text) for text in texts]
  others = [without_subject(text) for text in others]
  if len(others) == 1:
    return first + (", then ", " and then ", ", and after that ")[variant % 3] + others[0] + "."
  middle, last = ((", then ", " and finally "), (", then ", ", then "), (", then ", " and then "))[variant % 3]
  return first + middle + others[0] + last + others[1] + "."
