"""Captions by kinematics: true sentences about a motion, from measurements of its joints.

`describe` makes them from joints, `data.kinematic_captions` adds them to the captions of a clip, and
`data.describe_folders` writes a table of captions for `motion-jax data build`. The rules that detect events are in
`analysis.events`; uncertain events get no sentence. If a clip has captions, only events that these mention are
described: for "kick" the foot and the count, for a dance nothing. Sentences are a pure function of joints, words and
id.
"""
import re
import zlib
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.event_words import sentence
from motion_jax.analysis.events import Event, find_events
from motion_jax.motion.retiming import resample

FPS = 20.0       # rate at which events are detected, independent of the file's
SENTENCES = 3    # paraphrases of a clip

# Subjects that state a manner: "an exhausted person", "an old man".
_MANNERED = re.compile(r"^an? [a-z-]+ (?:person|man|woman)\b", re.IGNORECASE)
# Actions with dozens of captured clips in every manner. For other actions, one sentence in three does not state the
# manner: otherwise hardly any sentence would say that just "a person" kicks.
_IN_EVERY_MANNER = {"walk", "run", "raise", "wave", "turn", "still"}

# Patterns of captions, and the kinds of events that may then be described.
_SPOKEN = (
    (r"walk|strid|stroll|march|\bsteps?\b|sneak|tiptoe|moves? (off|back)|navigate", ("walk", "turn", "still")),
    (r"\brun|jog|dash|sprint", ("run", "turn", "still")),
    (r"\bturn", ("turn",)),
    (r"kick", ("kick",)),
    (r"punch|boxing|\bboxes\b|\bstrik|\bfists?\b", ("punch",)),
    (r"(rais|lift|put|reach|grab|stretch).*\b(hands?|arms?|high|above)\b", ("raise", "still")),
    (r"\bwav(e|es|ing)\b", ("wave", "still")),
    (r"jump|\bhop|leap", ("jump", "hop")),
    (r"squat", ("squat",)),
    (r"\bbow", ("bow", "still")),
    (r"(floor|ground).*\b(item|object|something|hand)|scoop", ("reach-floor",)),
    (r"\b(lie|lies|lying)\b", ("lie-down",)),
    (r"(rotat|circl)\w* .*arms?", ("arm-circle",)),
    (r"\bstand(s|ing)? still|do(es)? nothing", ("still",)),
)
# Motions for which the rules are not calibrated, or on uneven ground, are not described.
UNKNOWN = re.compile(r"danc|salsa|lambada|charleston|pirouette|arabesque|ballet|jete|playground|climb|ladder|uneven|"
                      r"terrain|stool|karate|sword|laugh|wash|basketball", re.IGNORECASE)


class Correction(NamedTuple):
  """Correction of wrong captions of a label: `said` becomes `shown`.

  shows: fields of an event. It applies to clips with events of that kind, all of which have these fields.
  """
  label: str
  shows: dict
  said: str
  shown: str


CORRECTIONS = (
    # Bandai's walk-left and walk-right are diagonal walks, 20 to 50 degrees off straight ahead.
    Correction("walk-left", {"kind": "walk", "way": "forward-left"}, "to the left", "diagonally forward to the left"),
    Correction("walk-right", {"kind": "walk", "way": "forward-right"}, "to the right",
               "diagonally forward to the right"),
    # Four of Bandai's clips (masculine 006 and 007) turn to the side opposite to their names.
    Correction("walk-turn-left", {"kind": "turn", "side": "right"}, "left", "right"),
    Correction("walk-turn-right", {"kind": "turn", "side": "left"}, "right", "left"),
    # HDM05's cuts of jogging in a circle are quarters of one.
    Correction("jog left circle, 4 steps", {"kind": "run", "path": "curve"}, "in a circle", "in a curve"),
)


def describe(joints, fps=FPS, words=None, key="") -> list[str]:
  """Up to three equivalent sentences about joints (T, 22, 3) in metres; none if the rules detect nothing for certain.

  words: existing captions; only events that they mention are described. None: all events. key: an id, which selects the
  wording.
  """
  return sentences(events_of(joints, fps), (len(joints) - 1) / fps, words, key)


def sentences(events, seconds, words=None, key="", subject="", plain=None) -> list[str]:
  """Sentences about the events of a motion of `seconds` seconds; words and key: see `describe`.

  subject: the subject, if it states a manner (`who_moves`). plain: number of sentences that do not state it anyway; by
  default one for actions that are captured in few manners, else none.
  """
  said, first = spoken_of(events, words), zlib.crc32(key.encode())
  if plain is None:
    plain = 0 if {event.kind for event in said} <= _IN_EVERY_MANNER else 1
  texts = (sentence(said, seconds, first + k, subject if k >= plain else "") for k in range(SENTENCES))
  return list(dict.fromkeys(filter(None, texts)))


def who_moves(captions) -> str:
  """The subject of a clip's captions if one states a manner: "an exhausted person"; else "".

  A kinematic caption with just "a person" for a mannered clip would teach that "a person" means any manner.
  """
  matches = filter(None, map(_MANNERED.match, captions))
  return next((match[0] for match in matches), "")


def events_of(joints, fps):
  """The events of joints (T, 22, 3) at any frame rate, detected at `FPS`."""
  return find_events(resample(np.asarray(joints, np.float64), fps, FPS), FPS)


def corrected(text, label, events) -> str:
  """A caption of a clip of this label, with contradictions to the events corrected by `CORRECTIONS`."""
  for rule in CORRECTIONS:
    same_kind = [event._asdict() for event in events if event.kind == rule.shows["kind"]]
    if label == rule.label and same_kind and all(rule.shows.items() <= event.items() for event in same_kind):
      text = text.replace(rule.said, rule.shown)
  return text


def spoken_of(events, words=None) -> list[Event]:
  """The events that captions mention: all if words is None, none if they mention unknown kinds of motion."""
  if words is None:
    return list(events)
  if UNKNOWN.search(words):
    return []
  kinds = {kind for pattern, kinds in _SPOKEN if re.search(pattern, words, re.IGNORECASE) for kind in kinds}
  return [event for event in events if event.kind in kinds]
