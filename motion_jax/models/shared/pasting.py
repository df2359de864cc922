"""Sampled frames put back into the clip they belong to; all other frames stay as and where they were.

A method samples latents (`inpaint`); here each clip becomes the features it reads, and what comes back becomes the
clip's own motion again: cleanup (`motion.cleanup`), the clip's own body (`known_motion`), and alignment, blending and
feet at the borders (`motion.filling`).
"""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.models.results import Motion, Motions, captions_with, cleanup_record, features_of, gathered
from motion_jax.models.shared.known_motion import KnownMotion, at_rate, clip_of
from motion_jax.models.shared.spans import TASKS
from motion_jax.motion import step_records
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.filling import fill_frames, in_spans, runs_of
from motion_jax.shapes import Bool, Float
from motion_jax.utils.errors import InputError

Spans = Sequence[Sequence[int]]  # [(first frame, the one past the last), ...]


class Edit(NamedTuple):
  """A clip to edit: its motion, which frames are new (T,), and the frames start:start + count that a model samples
  from, as features (count, F), not normalized. in_place: it was given as features, and so it is returned."""
  clip: Clip
  known: KnownMotion
  new: Bool[np.ndarray, " t"]
  start: int
  features: Float[np.ndarray, "n f"]
  in_place: bool = False

  @property
  def window(self) -> slice:
    return slice(self.start, self.start + len(self.features))

  @property
  def new_in_window(self) -> Bool[np.ndarray, " n"]:
    return self.new[self.window]


def requested_frames(num_frames: int, task: str | None = None, keep: Spans | None = None, change: Spans | None = None
                     ) -> Bool[np.ndarray, " t"]:
  """(num_frames,): the frames that one of task, keep and change requests to be new.

  A task of `spans.TASKS`: "prefix" keeps the first half, "suffix" the second, "inpainting" the first and last
  quarter, "outpainting" the middle. Spans are in frames.
  """
  new = np.zeros(num_frames, bool)
  if task is not None:
    if task not in TASKS:
      raise InputError(f"got task {task!r}, expected one of {', '.join(TASKS)}")
    for first, past in TASKS[task]:
      new[round(first * num_frames):round(past * num_frames)] = True
    return new
  spans = change if keep is None else keep
  new = in_spans(spans if spans is not None else [], num_frames)
  return new if keep is None else ~new


def prepare(model: Any, motion: Any, new: Callable[[int], Bool[np.ndarray, " t"]]) -> Edit:
  """The edit of a motion (see `known_motion.clip_of`) whose frames new(num_frames) -> (T,) are to be sampled.

  Of a motion longer than the model knows, the seconds around the new frames are what it samples from.
  """
  layout = model.stats.layout
  clip = clip_of(motion, layout)
  given = None if isinstance(motion, Clip) else clip.features  # read as they are
  joints = at_rate(clip, model.fps, layout.skeleton) if given is None else np.asarray(clip.joints, np.float64)
  known, flags = KnownMotion.of(joints, layout.skeleton), new(len(joints))
  if not flags.any():
    raise InputError("everything is kept, so there is nothing to make; choose a span to change, or a shorter one to "
                     "keep")
  most, unit = model.config.data.max_frames, model.frames_per_latent
  first, past = np.flatnonzero(flags)[[0, -1]] + [0, 1]
  if past - first > most - 2 * unit * (len(joints) > most):
    raise InputError(f"got {past - first} frames to make at {model.fps:g} frames a second, the model "
                     f"{model.folder.name} knows motions of {most}; mark a shorter span")
  if len(joints) < unit:
    raise InputError(f"got a motion of {len(joints)} frames at {model.fps:g} frames a second, expected {unit} or more")
  start = max(0, min((first + past - most) // 2, len(joints) - most))
  start -= min(start, (start - first) % unit)  # the first new frame begins a latent
  window = slice(start, start + most)
  features = given if given is not None and len(given) <= most else features_of(model, known.on_model[window])
  return Edit(clip, known, flags, start, features, given is not None)


def paste(model: Any, edit: Edit, prompt: str, seed: int | None, decoded: Float[np.ndarray, "n f"],
          cleanup: bool, record: dict[str, Any]) -> Motion:
  """The motion of an edit: its clip with new frames from decoded (count, F), the unnormalized features of its window.
  """
  layout = model.stats.layout
  fresh, shown = (np.array(layout.to_joints(x), np.float64) for x in (decoded, edit.features))
  known, new = edit.known.cut(edit.start, edit.window.stop), edit.new_in_window
  steps = [step_records.record("sample", "new frames sampled between kept ones")]
  if cleanup and layout.has_fixed_bones:
    before, fresh = fresh, clean_up(fresh, layout.contacts(decoded), layout.skeleton, smoothing=model.smoothing)
    steps.append(cleanup_record(before, fresh, layout.skeleton, edit.start))
  if cleanup:
    fresh = known.own_body(fresh, shown)
  joints = np.array(edit.known.joints)
  if new.all():  # nothing is kept: it begins where the clip does
    fresh = fill_frames(np.concatenate([fresh[:1], fresh]), np.concatenate([known.joints[:1], known.joints]),
                        np.append(False, new), known.own, model.fps, cleanup)[1:]
  else:
    fresh = fill_frames(fresh, known.joints, new, known.own, model.fps, cleanup)
  joints[edit.window] = fresh
  joints = joints.astype(np.float32)
  runs = [list(run) for run in runs_of(edit.new)]
  seconds = [(first / model.fps, past / model.fps) for first, past in runs]
  captions = (Caption(prompt),) if edit.new.all() else captions_with(
      [caption for caption in edit.clip.captions if caption.text.strip()], seconds, prompt, len(edit.new) / model.fps)
  return Motion(joints, model.fps, captions, id=edit.clip.id, source=model.id,
                license=edit.clip.license or model.license, skeleton=layout.skeleton,
                features=features_of_edit(model, edit, joints),
                meta=dict(prompt=prompt, seed=seed, cleanup=bool(cleanup), steps=steps) | record | dict(
                    edited=edit.clip.source or edit.clip.id, made=runs))


def features_of_edit(model: Any, edit: Edit, joints: Float[np.ndarray, "t j 3"]
                     ) -> Float[np.ndarray, "t f"]:
  """Features of joints (T, J, 3) of an edited clip, on the model's bones; in the clip's own place if it came as
  features."""
  layout, on_model = model.stats.layout, np.asarray(joints, np.float64)
  if not edit.known.is_on_model:
    on_model = KnownMotion.of(joints, layout.skeleton).on_model
  return features_of(model, on_model) if not edit.in_place else (
      layout.from_joints_in_place(on_model, model.config.data.mode))


def edited(model: Any, clips: Sequence[Any], prompts: Sequence[str],
           new: Callable[[int], Bool[np.ndarray, " t"]], keys: jax.Array, seeds: Sequence[int | None], cleanup: bool,
           sampling: dict[str, Any], task: str = "spans") -> Motions:
  """Clips whose frames new(num_frames) -> (T,) are sampled once and pasted back, in one batch."""
  edits = [prepare(model, clip, new) for clip in clips]
  decoded, record = model.inpaint([edit.features for edit in edits], [edit.new_in_window for edit in edits], prompts,
                                 keys, sampling)
  return gathered([paste(model, *row, cleanup, record | dict(task=task))
                   for row in zip(edits, prompts, seeds, decoded)])
