"""Captions by kinematics: sentences about what a motion does, from measures of its joints, so that they are true.

`describe` makes them of joints, `data.kinematic_captions` adds them to a clip's own captions, and
`data.describe_folders` writes the table of captions of a folder that `motion-jax data build` reads. The rules that find
events are in `analysis.events`; where they are not sure, no sentence is made. Beside a clip's own captions only events
that these mention are described: of a caption with "kick" which foot and how often, of a dance nothing. Sentences are a
pure function of joints, words and id.
"""
import re
import zlib
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.event_words import sentence
from motion_jax.analysis.events import Event, find_events
from motion_jax.motion.retiming import resample

FPS = 20.0       # the rate at which events are looked for, so that a description does not depend on the file's
SENTENCES = 3    # paraphrases of a clip

# Who moves, as a caption that names a manner begins: "an exhausted person", "an old man".
_MANNERED = re.compile(r"^an? [a-z-]+ (?:person|man|woman)\b", re.IGNORECASE)
# Actions of which captures have dozens of clips in every manner. Of the others one sentence in three leaves the manner
# out, or hardly any would say of just "a person" that they kick.
_IN_EVERY_MANNER = {"walk", "run", "raise", "wave", "turn", "still"}

# What captions must say (a pattern) for which events are described beside them.
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
# Where the rules were not calibrated, or where the ground is not flat, nothing is said.
UNKNOWN = re.compile(r"danc|salsa|lambada|charleston|pirouette|arabesque|ballet|jete|playground|climb|ladder|uneven|"
                      r"terrain|stool|karate|sword|laugh|wash|basketball", re.IGNORECASE)


class Correction(NamedTuple):
  """Captions of clips of a label that do something else: `said` in them becomes `shown`.

  shows: fields of an event; where a clip has events of that kind and all of them are so, its captions are wrong.
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
    # Four of Bandai's clips (masculine 006 and 007) turn to the other side than their names say.
    Correction("walk-turn-left", {"kind": "turn", "side": "right"}, "left", "right"),
    Correction("walk-turn-right", {"kind": "turn", "side": "left"}, "right", "left"),
    # HDM05's cuts of jogging in a circle are quarters of one.
    Correction("jog left circle, 4 steps", {"kind": "run", "path": "curve"}, "in a circle", "in a curve"),
)


def describe(joints, fps=FPS, words=None, key="") -> list[str]:
  """Sentences about joints (T, 22, 3) in metres, up to three that say the same; none where the rules find nothing sure.

  words: what is said of the motion already; only what they speak of is described. None: whatever is found. key: an id;
  the sentences of different ids are put in different words.
  """
  return sentences(events_of(joints, fps), (len(joints) - 1) / fps, words, key)


def sentences(events, seconds, words=None, key="", subject="", plain=None) -> list[str]:
  """Sentences about the events of a motion of `seconds` seconds; words and key as `describe` takes them.

  subject: who moves, where that tells a manner (`who_moves`). plain: how many of the sentences leave it out all the
  same; by default one, where captures show what is done in few manners, else none.
  """
  said, first = spoken_of(events, words), zlib.crc32(key.encode())
  if plain is None:
    plain = 0 if {event.kind for event in said} <= _IN_EVERY_MANNER else 1
  made = (sentence(said, seconds, first + number, subject if number >= plain else "") for number in range(SENTENCES))
  return list(dict.fromkeys(filter(None, made)))


def who_moves(captions) -> str:
  """Who moves in a clip's captions, where one of them tells the manner so: "an exhausted person"; else "".

  A sentence by kinematics that says no more than "a person" of a clip in a manner teaches that any manner is meant.
  """
  found = filter(None, map(_MANNERED.match, captions))
  return next((match[0] for match in found), "")


def events_of(joints, fps):
  """The events of joints (T, 22, 3) at any frame rate, found at `FPS`."""
  return find_events(resample(np.asarray(joints, np.float64), fps, FPS), FPS)


def corrected(text, label, events) -> str:
  """A caption of a clip of this label, in which what the events contradict is put right."""
  for rule in CORRECTIONS:
    own = [event._asdict() for event in events if event.kind == rule.shows["kind"]]
    if label == rule.label and own and all(rule.shows.items() <= event.items() for event in own):
      text = text.replace(rule.said, rule.shown)
  return text


def spoken_of(events, words=None) -> list[Event]:
  """The events that captions speak of, all of them without captions, none beside captions of what is not known."""
  if words is None:
    return list(events)
  if UNKNOWN.search(words):
    return []
  kinds = {kind for pattern, kinds in _SPOKEN if re.search(pattern, words, re.IGNORECASE) for kind in kinds}
  return [event for event in events if event.kind in kinds]
