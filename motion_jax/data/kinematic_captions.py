"""Correct and complete the captions of a clip by its kinematics (`motion_jax.analysis`)."""
from motion_jax.analysis.describe import corrected, events_of, sentences, who_moves
from motion_jax.analysis.events import Event
from motion_jax.data.clip import Caption, Clip
from motion_jax.motion.skeleton import HUMANML3D


def with_kinematic_captions(clip: Clip, events: list[Event] | None = None) -> Clip:
  """The clip with corrected captions (`describe.CORRECTIONS`), followed by captions by kinematics.

  events: those of its joints at `describe.FPS`, if known. Clips of other skeletons than HumanML3D's 22 joints are
  returned unchanged.
  """
  if clip.skeleton is not HUMANML3D:
    return clip
  label = str(clip.meta.get("content") or clip.meta.get("label") or "")
  whole_clip = [caption for caption in clip.captions if not caption.start and not caption.end]
  words = " ".join([label, *(caption.text for caption in whole_clip)])
  events = events_of(clip.joints, clip.fps) if events is None else events
  kept = tuple(Caption(corrected(caption.text, label, events), caption.start, caption.end) for caption in clip.captions)
  known = {caption.text for caption in kept}
  seconds = (clip.num_frames - 1) / clip.fps
  subject = who_moves(caption.text for caption in whole_clip)
  new = (text for text in sentences(events, seconds, words, clip.id, subject) if text not in known)
  return clip.replace(captions=kept + tuple(map(Caption, new)))
