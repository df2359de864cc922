"""Retime clips to 0.7 to 1.4 times their pace (`motion.retiming`), with captions that say "slowly" or "quickly".

Walks, runs and waves are slow or quick compared with the usual pace of people (`analysis.event_words`), any other
action compared with the median of its archive's clips of it. A clip is kept only if the rules detect the same events as
before.
"""
import collections
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS, sentences
from motion_jax.analysis.event_words import QUICKLY, SLOWLY, pace, usual_pace
from motion_jax.analysis.events import find_events
from motion_jax.data.augment.parts import MOST, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.contacts import velocity
from motion_jax.motion.retiming import retimed
from motion_jax.text.captions import known_subject, without_subject

SLOWEST, QUICKEST = 0.7, 1.4
_KNOWN = 5        # least number of clips of an action for a median pace
_UNSAID = 0.3     # share of the clips at a usual pace that are kept
_MOVES = 0.3      # metres a second of the fastest joint of a body that does something
_TEMPO = re.compile(r"slow|quick|fast|rapid|hurr|brisk|leisur|speed|pace|sudden|hast|energe|activ|tired|exhaust|lazi|"
                    r"giant|heav|calm|gentl|\bsecond", re.IGNORECASE)


def time_warp(parts, rng) -> Iterator[Clip | None]:
  """Actions at another pace: "walks forward slowly", "someone quickly bows"."""
  ready = [part for part in parts if part.known and len(part.joints) <= MOST]
  paces = collections.defaultdict(list)
  for part in ready:
    paces[part.name].append(_pace(part.joints))
  usual = {name: float(np.median(members)) for name, members in paces.items() if len(members) >= _KNOWN}
  names, number = sorted(paces), 0
  while names:
    number += 1
    name = names[rng.integers(len(names))]
    members = [part for part in ready if part.name == name]
    yield _warped(members[rng.integers(len(members))], usual.get(name, 0.0), rng, number)


def _pace(joints):
  """Speed of a body while it moves, metres a second, root mean square over joints."""
  speed = np.linalg.norm(velocity(joints, FPS), axis=-1)
  moving = speed.max(1) > _MOVES
  return float(np.sqrt((speed[moving] ** 2).mean())) if moving.any() else 0.0


def _warped(part, usual, rng, number):
  rate = float(np.exp(rng.uniform(np.log(SLOWEST), np.log(QUICKEST))))
  kept = rng.random() < _UNSAID
  joints = retimed(part.joints, rate)[:MOST]
  events = find_events(joints, FPS)
  if _done(events) != _done(part.events):
    return None
  word = _word(events, _pace(joints), usual)
  if not word and not kept:
    return None
  texts = [caption.text for caption in part.clip.captions if not _TEMPO.search(caption.text)]
  said = [at_pace(text, word, variant + number) for variant, text in enumerate(texts)]
  subject = "" if _TEMPO.search(part.subject) else part.subject
  said += [text for text in sentences(events, (len(joints) - 1) / FPS, part.words, f"{part.clip.id}{number}", subject)
           if bool(word) == bool(_TEMPO.search(text))]
  said = [text for text in said if text]
  return new_clip("warp", number, joints, said, part, f"{part.name} {word}".strip()) if said else None


def _done(events):
  """Detected actions, ignoring speed."""
  return sorted((event.kind, event.side, event.way, event.path, event.count if event.kind != "wave" else 0)
                for event in events if event.kind not in ("still", "turn"))


def _word(events, speed, usual):
  """"slowly", "quickly", or "" if the pace is usual or unknown."""
  acts = [event for event in events if event.kind not in ("still", "turn")]
  if len(acts) == 1 and usual_pace(acts[0]):
    return pace(acts[0])
  ratio = speed / usual if usual and speed else 1.0
  return "slowly" if ratio < SLOWLY else "quickly" if ratio > QUICKLY else ""


def at_pace(text, word, variant) -> str:
  """A caption with a word for its pace; "" if none can be added."""
  if not word:
    return text
  text = re.sub(r"[\s.!]+$", "", text)
  if not known_subject(text) or re.search(r",| then | and |^\S+ (\S+ )?is ", text):
    return ""
  if variant % 3 == 1:
    return f"{text[:-len(without_subject(text))]}{word} {without_subject(text)}."
  return f"{text} {('fast' if word == 'quickly' else 'at a slow pace') if variant % 3 == 2 else word}."
