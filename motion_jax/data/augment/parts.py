"""Clips as parts of others: on the skeleton's bones, with their events, and where they may be entered and left."""
import re
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.describe import FPS, UNKNOWN, who_moves
from motion_jax.analysis.events import Event, find_events
from motion_jax.analysis.signals import JOINT, PAIR
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.kinematic_captions import with_kinematic_captions
from motion_jax.motion.contacts import velocity
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.splicing import REACH
from motion_jax.text.captions import known_subject, without_subject

MOST = 196     # frames of a clip that is made: what generators are trained on
SHORTEST = 36  # frames of a walk that are worth a sentence
# Of three kinematic captions of a bent path or a counted clip, the number that leave the manner out. Few captured clips
# show such motions: with fewer plain captions, models seldom walked a circle for "a person walks in a circle".
PLAIN = 2
_EDGE = 14     # frames at either end of a clip in which its action may not have begun, or be over
_ENDS = re.compile(r"\b(then|still|stops?)\b")
_LEAD = 0.25   # seconds before the rules find an action in which it may have begun


class Part(NamedTuple):
  """A clip that others are made of: joints (T, 22, 3) with the skeleton's bone lengths, on the floor, and its events.

  going: whether it walks or runs straight on and does nothing else. enter, leave: the frames at which it may be entered
  and left, so that what its captions say is still done. sayings: its captions that can be strung together.
  """
  clip: Clip
  joints: np.ndarray
  events: tuple[Event, ...]
  going: bool
  enter: range
  leave: range
  sayings: tuple[str, ...]

  @property
  def name(self) -> str:
    """What it shows, in the archive's words."""
    return str(self.clip.meta.get("content") or self.clip.meta.get("label") or self.clip.id)

  @property
  def words(self) -> str:
    """All that is said of it."""
    return " ".join([self.name, *(caption.text for caption in self.clip.captions)])

  @property
  def subject(self) -> str:
    """The subject of its captions if that expresses the manner; else ""."""
    return who_moves(caption.text for caption in self.clip.captions)

  @property
  def known(self) -> bool:
    """Whether the rules that find events know motions of its kind."""
    return not UNKNOWN.search(self.words)


def usable(clip) -> bool:
  return clip.skeleton is HUMANML3D and clip.fps == FPS and clip.num_frames >= 24 and bool(clip.captions)


def part_of(clip) -> Part:
  """A clip as a part; its captions are corrected and completed by kinematics (`data.kinematic_captions`)."""
  joints = retarget(clip.joints)
  events = tuple(find_events(joints, FPS))
  own = with_kinematic_captions(clip, events)
  going = len(events) == 1 and events[0].kind in ("walk", "run") and events[0].path == "straight" and bool(
      events[0].way) and events[0].end - events[0].start > 0.85 * (len(joints) - 1) / FPS
  acts = [event for event in events if event.kind not in ("still", "walk", "run")]
  if going:
    enter, leave = range(REACH, len(joints) - SHORTEST), range(SHORTEST, len(joints) - REACH)
  else:
    begin = min([_EDGE, *(int((event.start - _LEAD) * FPS) for event in acts)])
    end = max([len(joints) - _EDGE, *(int((event.end + _LEAD) * FPS) + 1 for event in acts)])
    enter, leave = range(REACH, max(begin, REACH)), range(min(end, len(joints) - REACH), len(joints) - REACH)
  return Part(own, joints, events, going, enter, leave, sayings(own))


def sayings(clip) -> tuple[str, ...]:
  """Captions with a subject that is known and a verb in the present tense, not too long, that name no rest: where
  another part follows, that may be gone."""
  return tuple(text for text in (caption.text for caption in clip.captions) if known_subject(text)
               and _says_what_is_done(without_subject(text)) and len(text.split()) < 14 and not _ENDS.search(text))


def _says_what_is_done(words):
  first = words.split(maxsplit=1)[0] if words else ""
  return first.endswith("s") and first != "is"


def resting(joints) -> np.ndarray:
  """Frames (T,) in which a body stands at ease: slow, upright, arms down, feet side by side."""
  slow = np.linalg.norm(velocity(joints, FPS, 0.2), axis=-1).max(1) < 0.5
  low = joints[:, PAIR["wrist"], 1].max(1) < joints[:, JOINT["spine3"], 1]
  line = joints[:, JOINT["neck"]] - joints[:, 0]
  upright = line[:, 1] > 0.96 * np.linalg.norm(line, axis=-1)
  feet = joints[:, PAIR["ankle"]]
  near = np.linalg.norm((feet[:, 0] - feet[:, 1])[:, [0, 2]], axis=-1) < 0.4
  return slow & low & upright & near & stands(joints, FPS).all(1)


def new_clip(kind, number, joints, captions, of, shows, spans=()) -> Clip:
  """A clip of a kind, made of the part `of` and maybe others; shows: its group; spans: (caption, first, past) frames.
  """
  return of.clip.replace(
      joints=joints.astype(np.float32), captions=tuple(Caption(text) for text in dict.fromkeys(captions)),
      id=f"{of.clip.id}+{kind}{number}", features=None,
      meta={"content": f"{kind}: {shows}", "clip": of.clip.meta.get("clip", of.clip.id), "made": kind,
            "spans": tuple(spans)})
