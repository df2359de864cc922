"""Edits of motions: regenerate requested frames, and keep the poses and places of all others.

The library samples the frames and pastes them into the clip (`models.shared.pasting`). Here they are scored by the
requirements of the prompt, by bone lengths and by foot skating, and resampled until an attempt is good enough.
"""
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from motion_jax.control.constraints import Constraint, KeepParts
from motion_jax.control.finishing import with_parts
from motion_jax.control.keys import without_slack
from motion_jax.control.spans import missed, near_keys, project_frames
from motion_jax.models.results import Motion, Motions, captions_with, features_of, gathered
from motion_jax.models.shared import pasting
from motion_jax.models.shared.known_motion import at_rate, clip_of
from motion_jax.motion.filling import runs_of
from motion_jax.motion.skeleton import bone_lengths
from motion_jax.motion.step_records import added, record
from motion_jax.utils.errors import InputError
from motion_jax_studio import resampling
from motion_jax_studio.checks.best_of import best_of
from motion_jax_studio.checks.reports import report, unmet_requirements
from motion_jax_studio.checks.violations import can_be_checked, excess_speed, violation_score
from motion_jax_studio.language import Plan
from motion_jax_studio.planning.job import Job

_DISTORTED = 0.25  # largest error of bone lengths, as a share, in 90 % of the new frames
_SLIDES = 0.3     # metres per second, largest average speed of the slower foot, except in runs
_SHORTEST = 0.5  # seconds; an action can be seen only in longer spans


class Edit(NamedTuple):
  """An edited motion, and the distortion of its new frames by bone lengths and foot skating: 0 if they are good."""
  motion: Motion
  distortion: float


def edited(job: Job, clips: Sequence[Any], new: Callable[[int], np.ndarray], max_attempts: int, task: str = "spans",
           corrects: bool = True) -> Motions:
  """Regenerate frames of clips (see `known_motion.clip_of`) from the prompts of a job, the best of up to max_attempts.

  new(num_frames) -> (T,) bool, the frames to sample. corrects: keep the legs of the clip if the prompt is about the
  upper body and the new feet slide. Attempts are recorded in meta["attempts"], as in `resampling`.
  """
  model, fps = job.model, job.planner.fps
  edits = [pasting.prepare(model, clip, new) for clip in clips]
  prompts = [_network_prompt(prompt, plan) for prompt, plan in zip(job.prompts, job.plans)]
  checked = max_attempts > 1 and can_be_checked(model)
  required = [plan.requirements if plan and checked else [] for plan in job.plans]
  keeps_legs = [corrects and can_be_checked(model) and job.cleanup and plan is not None and moves_upper_body(plan)
                for plan in job.plans]

  def build_edit(row, features, about):
    motion = pasting.paste(model, edits[row], job.prompts[row], job.seeds[row], features, job.cleanup,
                           about | dict(task=task))
    motion = motion.replace(meta=motion.meta | {"steps": [*job.records[row], *motion.meta["steps"]]})
    if keeps_legs[row] and sliding(motion):
      motion = on_own_legs(motion, edits[row].known.joints, partial(pasting.features_of_edit, model, edits[row]))
    slides = 0.0 if any(requirement.kind == "run" for requirement in required[row]) else sliding(motion)
    return Edit(motion, _distortion(model, features, edits[row].new_in_window) + slides)

  def attempts(rows, number, factor):
    part = job.select(rows, keys=resampling.keys_again(job, rows, number),
                      sampling=resampling.reweighed(model, job.sampling, factor)) if number else job
    decoded, about = model.inpaint([edits[i].features for i in rows], [edits[i].new_in_window for i in rows],
                                   [prompts[i] for i in rows], part.keys, part.sampling)
    return [(build_edit(i, features, about), resampling.attempt_record(part, place, number))
            for place, (i, features) in enumerate(zip(rows, decoded))]

  def overdoes(row, number, best):
    """Whether the next attempt gets less guidance, because the body is distorted or too fast. A missing action needs
    more; with both faults, attempts alternate."""
    misses = best.score > best.sample.distortion + _excess(best.sample, required[row], fps)
    return not misses or bool(best.sample.distortion) and number % 2 == 0

  bests = best_of(resampling.with_guidance(attempts, overdoes, max_attempts),
                  lambda row, edit: _score(edit, required[row], fps), len(job.prompts), max_attempts)
  motions = [row.best.sample.motion for row in bests]
  unmet = [_unmet(motion, requirements, fps) + gliding_reports(motion, requirements, checked)
           for motion, requirements in zip(motions, required)]
  if job.warns:
    report([motion.meta["prompt"] for motion in motions], unmet, max_attempts)
  return gathered([resampling.with_attempts(*row, checked) for row in zip(motions, bests, unmet)])


def _network_prompt(prompt: str, plan: Plan | None) -> str:
  """The prompt for the network: that of the action for a plan of a single one, else the prompt as it was written."""
  if plan is None or len(plan.segments) > 1 or plan.segments[0].simultaneous or plan.segments[0].is_pause:
    return prompt
  return plan.segments[0].action.prompt_with_count


def edited_through(job: Job, clip: Any, control: Sequence[Constraint], new: Callable[[int], np.ndarray], **options: Any
                   ) -> Motion:
  """Regenerate frames of a clip so that they meet keys, constraints with times in these frames.

  The clip is bent through the keys (`control.spans`); the model samples the new frames again, except those next to a
  key; the result is projected onto the keys. All other frames stay equal, bit for bit, at the model's frame rate.
  """
  model, layout = job.model, job.model.stats.layout
  clip = clip_of(clip, layout)
  joints = at_rate(clip, model.fps, layout.skeleton)
  flags = new(len(joints))
  if not flags.any():
    raise InputError("everything is kept, so there is nothing to make; choose a span to change")
  bent = project_frames(joints, control, flags, model.fps)
  fixed = without_slack(control, joints, model.fps, flags)
  sampled = flags & ~near_keys(fixed, len(joints), model.fps, model.frames_per_latent // 2 + 1)
  motion, = edited(job, [clip.replace(joints=bent, fps=model.fps, features=None)],
                   lambda count: sampled if sampled.any() else flags, **options)
  met = np.where(flags[:, None, None], project_frames(motion.joints, control, flags, model.fps),
                 joints).astype(np.float32)
  runs = [list(run) for run in runs_of(flags)]
  captions = captions_with([caption for caption in clip.captions if caption.text.strip()],
                           [(first / model.fps, past / model.fps) for first, past in runs], job.prompts[0],
                           len(joints) / model.fps)
  step = record("constrain", f"{len(control)} keys met", motion.joints, met, motion.skeleton)
  notes = missed(met, control, motion.joints, flags, model.fps)
  about = dict(made=runs, control=[key.kind for key in control]) | ({"note": "; ".join(notes)} if notes else {})
  return motion.replace(joints=met, features=features_of(model, met), captions=tuple(captions),
                        meta=added(motion.meta | about, step))


def moves_upper_body(plan: Plan) -> bool:
  """Whether a plan has actions of arms or head only, which leave the legs free."""
  parts = {action.part for action in plan.actions}
  return bool(parts) and parts <= {"arms", "head"}


def on_own_legs(motion: Motion, clip: np.ndarray, features: Callable[[np.ndarray], Any]) -> Motion:
  """Put the new upper body on the legs that `clip` (T, J, 3) has in these frames. features(joints) -> their features.

  If the middle of a walk becomes "waves", a network samples a standing body, which would glide the metres to the kept
  frames after it.
  """
  spans = [(first / motion.fps, past / motion.fps) for first, past in motion.meta["made"]]
  keep = KeepParts(clip, ("legs",), motion.fps, spans)
  joints = with_parts(motion.joints, keep, motion.fps)
  return motion.replace(joints=joints, features=features(joints),
                        meta=added(motion.meta | dict(legs="kept"), record(
                            "correct", "legs of the clip kept", motion.joints, joints, motion.skeleton)))


def _distortion(model, decoded, new):
  """Error of the bone lengths of new frames, before they are pasted, above what is usual: 0 to 1."""
  joints = np.asarray(model.stats.layout.to_joints(decoded), np.float64)
  skeleton = model.stats.layout.skeleton
  usual = np.median(bone_lengths(joints, skeleton), axis=0)[1:]
  off = np.abs(bone_lengths(joints[new], skeleton)[:, 1:] / np.maximum(usual, 1e-9) - 1).max(1)
  return float(np.clip(np.percentile(off, 90) - _DISTORTED, 0.0, 1.0))


def sliding(motion: Motion) -> float:
  """Foot skating in new frames: speed of the slower foot over the ground above `_SLIDES`, metres per second."""
  skeleton = motion.skeleton
  ankles = motion.joints[:, [skeleton.left_feet[0], skeleton.right_feet[0]]][..., [0, 2]].astype(np.float64)
  steps = np.linalg.norm(np.diff(ankles, axis=0), axis=-1).min(1) * motion.fps * skeleton.unit
  slides = [steps[max(first - 1, 0):past].mean() for first, past in motion.meta["made"] if len(steps)]
  return float(np.clip(max(slides, default=0.0) - _SLIDES, 0.0, 1.0))


def gliding_reports(motion: Motion, requirements: Sequence[Any], checked: bool) -> list[str]:
  """[a sentence] if the body slides in new frames, because it travels to the kept frames without steps; else []."""
  if not checked or any(requirement.kind == "run" for requirement in requirements) or not sliding(motion):
    return []
  first, past = max(motion.meta["made"], key=lambda span: span[1] - span[0])
  root = motion.joints[[max(first - 1, 0), min(past, len(motion.joints) - 1)], 0][:, [0, 2]]
  return [f"the feet slide, for the kept frames are {np.linalg.norm(root[1] - root[0]):.1f} m apart; say how the body "
          "gets there, as in \"walks forward, then ...\""]


def _spans(motion):
  """Joints of each new span that is long enough to show an action, else of the whole motion."""
  spans = [motion.joints[first:past] for first, past in motion.meta["made"]]
  return [joints for joints in spans if len(joints) > _SHORTEST * motion.fps] or [motion.joints]


def _score(edit, requirements, fps):
  """Violation score of the span that shows the prompt best, plus the distortion of the new frames."""
  if not requirements:
    return edit.distortion
  missed = min(violation_score(joints, requirements, fps) for joints in _spans(edit.motion))
  return missed + edit.distortion


def _excess(edit, requirements, fps):
  return min(excess_speed(joints, requirements, fps) for joints in _spans(edit.motion))


def _unmet(motion, requirements, fps):
  if not requirements:
    return []
  best = min(_spans(motion), key=lambda joints: violation_score(joints, requirements, fps))
  return unmet_requirements(best, requirements, fps)
