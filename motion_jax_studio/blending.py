"""One motion followed by another, with a transition between them."""
from motion_jax.control import finishing
from motion_jax.data.clip import Caption, Clip
from motion_jax.models.shared.known_motion import on_our_body
from motion_jax.motion.skeleton import HUMANML3D


def blended(first: Clip, second: Clip, seconds: float = 1.0) -> tuple[Clip, float]:
  """Blend two clips; returns (clip, time in seconds at which the second begins). See `control.finishing.blend`.

  Both are converted to the frame rate of the first and to the skeleton of 22 joints.
  """
  fps = first.fps
  joints, border = finishing.blend(*(on_our_body(clip, fps, HUMANML3D) for clip in (first, second)), seconds, fps)
  texts = [" | ".join(caption.text for caption in clip.captions) for clip in (first, second)]
  captions = tuple(Caption(text, start, end) for text, start, end in
                   ((texts[0], 0.0, border / fps), (texts[1], border / fps, len(joints) / fps)) if text)
  return Clip(joints, fps, captions, id="blended", source=f"{first.source or first.id}, then "
              f"{second.source or second.id}", license=" ".join(dict.fromkeys(
                  clip.license for clip in (first, second) if clip.license))), border / fps
