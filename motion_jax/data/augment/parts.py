"""Clips as parts of others: with the skeleton's bones, their events, and frames at which to enter and leave them."""
import re
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.describe import FPS, UNKNOWN, who_moves
from motion_jax.analysis.events import Event, find_events
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.kinematic_captions import with_kinematic_captions
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.splicing import REACH
from motion_jax.text.captions import known_subject, without_subject

MOST = 196     # frames: largest length of a new clip, as in the training of generators
SHORTEST = 36  # frames: shortest walk with a caption
# Number, of three kinematic captions of a bent path or a counted clip, that do not state the manner. Few captured clips
# show such motions: with fewer plain captions, models seldom walked a circle for "a person walks in a circle".
PLAIN = 2
_EDGE = 14     # frames at either end of a clip that are assumed to lie outside its action
_ENDS = re.compile(r"\b(then|still|stops?)\b")
_LEAD = 0.25   # seconds by which an action may begin before its detection


class Part(NamedTuple):
  """A source clip: joints (T, 22, 3) with the skeleton's bone lengths, on the floor, and its events.

  going: whether it shows nothing but a straight walk or run. enter, leave: frames at which it may be entered and left
  without cutting its action. sayings: captions that can be combined with others.
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
    """Its content, as the archive describes it."""
    return str(self.clip.meta.get("content") or self.clip.meta.get("label") or self.clip.id)

  @property
  def words(self) -> str:
    """Its content and all captions."""
    return " ".join([self.name, *(caption.text for caption in self.clip.captions)])

  @property
  def subject(self) -> str:
    """The subject of its captions if that expresses a manner, else ""."""
    return who_moves(caption.text for caption in self.clip.captions)

  @property
  def known(self) -> bool:
    """Whether the event rules apply to motions of its kind."""
    return not UNKNOWN.search(self.words)


def usable(clip) -> bool:
  return clip.skeleton is HUMANML3D and clip.fps == FPS and clip.num_frames >= 24 and bool(clip.captions)


def part_of(clip) -> Part:
  """Makes a Part of a clip; captions are corrected and completed by kinematics (`data.kinematic_captions`)."""
  joints = retarget(clip.joints)
  events = tuple(find_events(joints, FPS))
  captioned = with_kinematic_captions(clip, events)
  going = len(events) == 1 and events[0].kind in ("walk", "run") and events[0].path == "straight" and bool(
      events[0].way) and events[0].end - events[0].start > 0.85 * (len(joints) - 1) / FPS
  acts = [event for event in events if event.kind not in ("still", "walk", "run")]
  if going:
    enter, leave = range(REACH, len(joints) - SHORTEST), range(SHORTEST, len(joints) - REACH)
  else:
    begin = min([_EDGE, *(int((event.start - _LEAD) * FPS) for event in acts)])
    end = max([len(joints) - _EDGE, *(int((event.end + _LEAD) * FPS) + 1 for event in acts)])
    enter, leave = range(REACH, max(begin, REACH)), range(min(end, len(joints) - REACH), len(joints) - REACH)
  return Part(captioned, joints, events, going, enter, leave, sayings(captioned))


def sayings(clip) -> tuple[str, ...]:
  """Short captions with a known subject and a verb in the present tense; without an end, which a following part may
  cut off."""
  return tuple(text for text in (caption.text for caption in clip.captions) if known_subject(text)
               and _says_what_is_done(without_subject(text)) and len(text.split()) < 14 and not _ENDS.search(text))


def _says_what_is_done(words):
  first = words.split(maxsplit=1)[0] if words else ""
  return first.endswith("s") and first != "is"



def new_clip(kind, number, joints, captions, of, shows, spans=()) -> Clip:
  """A new clip of a kind, from the part `of` and perhaps others; shows: its group; spans: (caption, first, past).
  """
  return of.clip.replace(
      joints=joints.astype(np.float32), captions=tuple(Caption(text) for text in dict.fromkeys(captions)),
      id=f"{of.clip.id}+{kind}{number}", features=None,
      meta={"content": f"{kind}: {shows}", "clip": of.clip.meta.get("clip", of.clip.id), "made": kind,
            "spans": tuple(spans)})
