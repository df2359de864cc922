"""Generated motions: clips with captions and a record of each step, which save themselves by extension.

`model` is a `TextToMotionModel` in each function: `base` imports this file, so it cannot import `base`.
"""
import dataclasses
import os
import pathlib
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.motion import step_records
from motion_jax.motion.blending import eased
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.representations import to_features, to_joints
from motion_jax.motion.skeleton import Skeleton
from motion_jax.shapes import Float, Num
from motion_jax.utils import timing


class Motion(Clip):
  """A clip that knows how to write itself: `motion.save("wave.mp4")`, by extension."""

  def save(self, path: str | os.PathLike, **options: Any) -> list[pathlib.Path]:
    """Writes npz, npy, bvh, glb, mp4, gif, html or png; returns the paths written."""
    from motion_jax import export
    return export.save(self, path, **options)

  def _repr_html_(self) -> str:
    """What a notebook shows: the viewer of `motion.save("wave.html")`, with all that it needs inside."""
    return _framed(self)


@dataclasses.dataclass(frozen=True, eq=False)
class Motions:
  """Generated motions: joints (B, T, J, 3), frame_mask (B, T) true where a motion is real; `motions[i]` is a Motion."""
  joints: np.ndarray
  frame_mask: np.ndarray
  features: np.ndarray  # (B, T, F), not normalized
  motions: tuple[Motion, ...]
  decoded: np.ndarray | None = None  # (B, longer, F), with the decoder's output after the end of each motion

  def __len__(self) -> int:
    return len(self.motions)

  def __getitem__(self, index: int) -> Motion:
    return self.motions[index]

  def __iter__(self) -> Iterator[Motion]:
    return iter(self.motions)

  def __repr__(self) -> str:
    shown = [repr(motion) for motion in self.motions[:8]]
    more = [f"... {len(self) - 8} more"] if len(self) > 8 else []
    return f"Motions({len(self)}:\n  " + "\n  ".join(shown + more) + ")"

  def _repr_html_(self) -> str:
    """What a notebook shows: one viewer with a selector."""
    return _framed(self.motions[:_SHOWN])


_SHOWN = 16  # motions that a notebook's viewer holds


def _framed(clips):
  """Embeds a viewer page in another page, as an iframe that loads nothing from the network."""
  from motion_jax import export
  return (f'<iframe srcdoc="{escape(export.page(clips))}" width="100%" height="480" style="border:0" '
          'sandbox="allow-scripts"></iframe>')


BLUE, ORANGE = (0.25, 0.5, 0.9), (0.95, 0.55, 0.15)  # given frames, new frames


def colors_of(motion: Motion) -> Float[np.ndarray, "t 3"]:
  """(T, 3): kept frames blue, new ones orange, for `motion.save(path, colors=...)`."""
  colors = np.tile(np.array(BLUE), (len(motion.joints), 1))
  for first, past in motion.meta["made"]:
    colors[first:past] = ORANGE
  return colors


def captions_with(captions: Sequence[Caption], spans: Sequence[tuple[float, float]], prompt: str, seconds: float
                  ) -> tuple[Caption, ...]:
  """Captions of a motion of this length, replaced by the prompt in the given spans."""
  pieces = [(caption.text, caption.start, caption.end if caption.end > caption.start else seconds)
            for caption in captions]
  for first, past in spans:
    pieces = [(text, a, b) for text, start, end in pieces
              for a, b in ((start, min(end, first)), (max(start, past), end)) if b > a + 1e-6]
  pieces += [(prompt, first, past) for first, past in spans]
  return tuple(Caption(*piece) for piece in sorted(pieces, key=lambda piece: piece[1]))


def captions_in_a_row(prompts: Sequence[str], ends: Sequence[int], fps: float) -> tuple[Caption, ...]:
  """Captions of segments that end at the given frames; a single one is about all of its clip."""
  if len(prompts) == 1:
    return (Caption(prompts[0]),)
  return tuple(Caption(prompt, start / fps, end / fps) for prompt, start, end in zip(prompts, [0, *ends[:-1]], ends))


def motions_of_prompts(model: Any, features: Any, prompts: Sequence[str], frames: Sequence[int],
                       seeds: Sequence[int | None], record: dict[str, Any], cleanup: bool) -> Motions:
  """`make_motions` for motions with one prompt each."""
  return make_motions(model, features, frames, [(Caption(prompt),) for prompt in prompts], seeds, record, cleanup)


def make_motions(model: Any, normalized: Any, frames: Sequence[int], captions: Sequence[tuple[Caption, ...]],
                 seeds: Sequence[int | None], record: dict[str, Any], cleanup: bool, ease: bool = False,
                 joints: Float[np.ndarray, "b t j 3"] | None = None) -> Motions:
  """Motions of normalized features (B, T, F); motion i is its first frames[i]. ease: smooth the changes of speed where
  captions change. joints: the decoded joints, if known already; not all features include where a motion begins."""
  length, layout = max(frames), model.stats.layout
  with timing.part("sample and decode"):
    normalized = np.asarray(normalized)  # waits for the device
  decoded = model.stats.denormalize(normalized)
  features = decoded[:, :length]
  joints = np.array(to_joints(features, layout) if joints is None else joints[:, :length])  # a copy, changed below
  if ease:
    for i, count in enumerate(frames):
      borders = [round(caption.start * model.fps) for caption in captions[i][1:]]
      joints[i, :count] = eased(joints[i, :count], borders, model.fps)
  steps = [[step_records.record("sample", _sampled(row))] for row in captions]
  if cleanup and layout.has_fixed_bones:
    with timing.part("cleanup"):
      for i, count in enumerate(frames):
        before = joints[i, :count].copy()
        joints[i, :count] = clean_up(before, layout.contacts(features[i, :count]), layout.skeleton,
                                     smoothing=model.smoothing)
        steps[i].append(cleanup_record(before, joints[i, :count], layout.skeleton))
  mask = np.arange(length) < np.array(frames)[:, None]
  motions = tuple(
      Motion(joints[i, :count], model.fps, captions[i], id=f"motion_{i}", source=model.id, license=model.license,
             skeleton=layout.skeleton, features=features[i, :count],
             meta=dict(prompt=" | ".join(c.text for c in captions[i]), seed=seeds[i], cleanup=bool(cleanup),
                     steps=steps[i]) | record)
      for i, count in enumerate(frames))
  return Motions(joints * mask[..., None, None], mask, features * mask[..., None], motions, decoded)


def _sampled(captions):
  return "one pass of the network" if len(captions) <= 1 else f"{len(captions)} prompts in sequence"


def cleanup_record(before: Num[np.ndarray, "t j 3"], after: Num[np.ndarray, "t j 3"], skeleton: Skeleton,
                   start: int = 0) -> step_records.Record:
  """Record of what `motion.cleanup` changed. start: the frame of the motion at which these joints begin."""
  return step_records.record("cleanup", "feet pinned, tremor removed", before, after, skeleton, start=start)


def features_of(model: Any, joints: Num[np.ndarray, "t j 3"]) -> Float[np.ndarray, "t f"]:
  """Features (T, F), not normalized, of joints, in the representation of the model's data."""
  ahead = np.concatenate([joints, 2 * joints[-1:] - joints[-2:-1]])  # a row looks one frame ahead
  return to_features(ahead, model.stats.layout, model.config.data.mode)[:len(joints)]


def gathered(motions: Sequence[Motion]) -> Motions:
  """Several motions as one batch."""
  longest = max(motion.num_frames for motion in motions)
  padded = lambda x: np.pad(x, ((0, longest - len(x)), *((0, 0),) * (x.ndim - 1)))
  mask = np.arange(longest) < np.array([motion.num_frames for motion in motions])[:, None]
  features = [motion.features for motion in motions if motion.features is not None]
  return Motions(np.stack([padded(motion.joints) for motion in motions]), mask, np.stack(list(map(padded, features))),
                 tuple(motions))


def extended_motion(model: Any, clip: Clip, past: Num[np.ndarray, "t j 3"], new: Num[np.ndarray, "n j 3"],
                    captions: Sequence[Caption], record: dict[str, Any], *steps: step_records.Record) -> Motion:
  """A Motion of a clip's joints (T, J, 3) followed by new ones, with the captions of both. steps: records of changes to
  the new ones."""
  border, end = len(past) / model.fps, (len(past) + len(new)) / model.fps
  before = tuple(c if c.start or c.end else Caption(c.text, 0.0, border) for c in clip.captions)
  after = tuple(Caption(c.text, c.start + border, c.end + border if c.end else end) for c in captions)
  return Motion(np.concatenate([past.astype(np.float32), new]), model.fps, before + after, id=clip.id,
                source=f"{clip.source or clip.id}, then {model.id}", license=clip.license or model.license,
                skeleton=model.stats.layout.skeleton, meta={"steps": [step_records.record(
                    "sample", f"{len(new)} frames after the {len(past)} of the motion"), *steps]} | record | {
                        "past_frames": len(past)})
