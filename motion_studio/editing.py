"""Edits as an animator needs them: new frames where they were requested, all others as and where they were.

A method remakes latents (`remake`); here each clip becomes the features it reads, and what comes back becomes the
clip's own motion again, in four steps: cleanup (`motion.cleanup`), the clip's own body (`known_motion`), alignment,
blending and feet at the borders (`motion.filling`), and the prompt checks of `generate`, on the new frames.
"""
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from motion_jax.control.constraints import KeepParts
from motion_jax.control.finishing import with_parts
from motion_jax.data.clip import Caption, Clip
from motion_jax.models.known_motion import KnownMotion, at_rate, clip_of
from motion_jax.models.results import Motion, Motions, captions_with, features_of, gathered
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.filling import fill_frames, runs_of
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.spans import TASKS
from motion_studio.checks import requirements as looking
from motion_studio.checks.attempts import FIRST_RESAMPLED, LOUDER, SOFTER, reweighed
from motion_studio.checks.reports import report, unmet_requirements
from motion_studio.language.sentences import actions_of

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel


_DISTORTED = 0.25  # of its length that a bone is off in one of ten new frames, of the frames that are usable


_SLIDES = 0.3     # metres a second: the slower foot's usual speed, on average, of all but runs, is below
_SHORTEST = 0.5  # seconds in which an action can be seen


class Job(NamedTuple):
  """A clip to edit: what is known of it, which frames are new (T,), and the frames start:start + count that a model
  remakes, as features (count, F), not normalized. in_place: it was given as features, and so it is returned."""
  clip: Clip
  known: KnownMotion
  new: np.ndarray
  start: int
  features: np.ndarray
  in_place: bool = False

  @property
  def window(self) -> slice:
    return slice(self.start, self.start + len(self.features))


class Made(NamedTuple):
  """An edited motion, and how far its new frames are from those of a body: 0 where they are fit for use."""
  motion: Motion
  distortion: float


def edits(model: "TextToMotionModel", clips: Sequence[Any], prompts: Sequence[str], new: Any, keys: jax.Array,
          seeds: Sequence[int | None], cleanup: bool, tries: int, sampling: dict[str, Any], task: str) -> Motions:
  """Clips (see `known_motion.clip_of`) whose frames `new(num_frames) -> (T,)` are made as the prompts say.

  tries: new frames that violate a requirement of their prompt are resampled, as `composed.generate` does it.
  """
  jobs = [_job(model, clip, new) for clip in clips]
  said = [_understood(model, prompt) for prompt in prompts]

  def make(rows, keys, sampling):
    decoded, about = model.remake([jobs[i].features for i in rows], [jobs[i].new[jobs[i].window] for i in rows],
                                  [said[i] for i in rows], keys, sampling)
    motions = [_motion(model, jobs[i], prompts[i], seeds[i], features, cleanup, about | dict(task=task))
               for i, features in zip(rows, decoded)]
    motions = [_on_own_legs(model, jobs[i], motion) if upper[i] and _skating(motion) else motion
               for i, motion in zip(rows, motions)]
    return [Made(motion, _distortion(model, features, jobs[i].new[jobs[i].window]) + (
        0.0 if any(one.kind == "run" for one in required[i]) else _skating(motion)))
            for i, motion, features in zip(rows, motions, decoded)]

  checked = tries > 1 and model.stats.layout.skeleton is HUMANML3D
  required = [looking.requirements_of(prompt) if checked else [] for prompt in prompts]
  upper = [checked and cleanup and _is_upper_body(prompt) for prompt in prompts]
  best = [(_score(made, one, model.fps), made) for made, one in zip(make(range(len(jobs)), keys, sampling), required)]
  for number in range(1, tries):
    rows = [i for i, (score, _) in enumerate(best) if score]
    # Words that weigh too much distort the body, or drive it on; words that do not show are to weigh more. Where both
    # is so, attempts take turns.
    missed = [best[i][0] > best[i][1].distortion + _excess(best[i][1], required[i], model.fps) for i in rows]
    softer = [i for i, misses in zip(rows, missed) if not misses or best[i][1].distortion and number % 2 == 0]
    for some, scale in (([i for i in rows if i not in softer], LOUDER), (softer, SOFTER)):
      if not some:
        continue
      folded = jax.numpy.stack([jax.random.fold_in(keys[i], FIRST_RESAMPLED + number) for i in some])
      with progress.part(f"attempt {number + 1} of {tries}, as the last new frames are not all that the prompt needs"):
        again = make(some, folded, reweighed(model, sampling, scale))
      for i, made in zip(some, again):
        score = _score(made, required[i], model.fps)
        if score < best[i][0]:
          best[i] = score, made._replace(motion=made.motion.replace(meta=made.motion.meta | dict(tries=number + 1)))
  motions = [made.motion for _, made in best]
  unmet = [_unmet(motion, one, model.fps) + _glides(motion, one, checked) for motion, one in zip(motions, required)]
  if model.reports_to_terminal:
    report(prompts, unmet, tries)
  return gathered([motion.replace(meta=motion.meta | dict(attempts=tries, unmet=missing)) if missing else motion
                   for motion, missing in zip(motions, unmet)])


def task_frames(task: str, num_frames: int) -> np.ndarray:
  """(num_frames,): the frames that a task makes: "prefix" keeps the first half, "suffix" the second, "inpainting" the
  first and last quarter, "outpainting" the middle."""
  if task not in TASKS:
    raise InputError(f"got task {task!r}, expected one of {', '.join(TASKS)}")
  new = np.zeros(num_frames, bool)
  for first, past in TASKS[task]:
    new[round(first * num_frames):round(past * num_frames)] = True
  return new


def _job(model, given, new):
  layout = model.stats.layout
  clip = clip_of(given, layout)
  held = None if isinstance(given, Clip) else clip.features  # read as they are
  joints = at_rate(clip, model.fps, layout.skeleton) if held is None else np.asarray(clip.joints, np.float64)
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
  features = held if held is not None and len(held) <= most else features_of(model, known.on_model[window])
  return Job(clip, known, flags, start, features, held is not None)


def _understood(model, prompt):
  """The words that the network gets: those of a single action as the model says it, any others as they are."""
  sentence = model.understand(prompt)
  one = sentence.segments[0]
  return one.action.counted if len(sentence.segments) == 1 and not one.also and not one.rests else prompt


def _motion(model, job, prompt, seed, decoded, cleanup, about):
  """The Motion of a job from the features (count, F), not normalized, that its window became."""
  layout = model.stats.layout
  made, shown = (np.array(layout.to_joints(x), np.float64) for x in (decoded, job.features))
  known, new = job.known.cut(job.start, job.window.stop), job.new[job.window]
  if cleanup and layout.has_fixed_bones:
    made = clean_up(made, layout.contacts(decoded), layout.skeleton)
  if cleanup:
    made = known.own_body(made, shown)
  joints = np.array(job.known.joints)
  if new.all():  # nothing is kept: it begins where the clip does
    made = fill_frames(np.concatenate([made[:1], made]), np.concatenate([known.joints[:1], known.joints]),
                       np.append(False, new), known.own, model.fps, cleanup)[1:]
  else:
    made = fill_frames(made, known.joints, new, known.own, model.fps, cleanup)
  joints[job.window] = made
  joints = joints.astype(np.float32)
  runs = [list(run) for run in runs_of(job.new)]
  seconds = [(first / model.fps, past / model.fps) for first, past in runs]
  captions = (Caption(prompt),) if job.new.all() else captions_with(
      [one for one in job.clip.captions if one.text.strip()], seconds, prompt, len(job.new) / model.fps)
  return Motion(joints, model.fps, captions, id=job.clip.id, source=model.id,
                license=job.clip.license or model.license, skeleton=layout.skeleton,
                features=_features(model, job, joints),
                meta=dict(prompt=prompt, seed=seed, cleanup=bool(cleanup)) | about | dict(
                    edited=job.clip.source or job.clip.id, made=runs))


def _features(model, job, joints):
  """Features of joints (T, J, 3), an edit of a job's clip, on the bones and, if the clip came as features, in the place
  of these."""
  layout = model.stats.layout
  on_model = np.asarray(joints, np.float64)
  if not job.known.is_on_model:
    on_model = KnownMotion.of(joints, layout.skeleton).on_model
  return layout.from_joints_in_place(on_model, model.config.data.mode) if job.in_place else features_of(model, on_model)


def _is_upper_body(prompt):
  """Whether a prompt names actions of arms or head only, which leave the legs free."""
  parts = {action.part for action in actions_of(prompt)}
  return bool(parts) and parts <= {"arms", "head"}


def _on_own_legs(model, job, motion):
  """The motion with the new upper body above the legs that the clip has in these frames.

  A network that remakes the middle of a walk as "waves" makes a body that stands; the kept frames after it are metres
  ahead, so it would glide there.
  """
  spans = [(first / motion.fps, past / motion.fps) for first, past in motion.meta["made"]]
  keep = KeepParts(job.known.joints, ("legs",), motion.fps, spans)
  joints = with_parts(motion.joints, keep, motion.fps)
  return motion.replace(joints=joints, features=_features(model, job, joints),
                        meta=motion.meta | dict(legs="kept"))


def _distortion(model, decoded, new):
  """How far the bones of new frames are from their lengths, as the network made them: 0 of those of a usual motion."""
  joints = np.asarray(model.stats.layout.to_joints(decoded), np.float64)
  skeleton = model.stats.layout.skeleton
  usual = np.median(bone_lengths(joints, skeleton), axis=0)[1:]
  off = np.abs(bone_lengths(joints[new], skeleton)[:, 1:] / np.maximum(usual, 1e-9) - 1).max(1)
  return float(np.clip(np.percentile(off, 90) - _DISTORTED, 0.0, 1.0))


def _skating(motion):
  """How much faster than usual, metres a second, the slower of both feet slides over the ground in new frames."""
  skeleton = motion.skeleton
  ankles = motion.joints[:, [skeleton.left_feet[0], skeleton.right_feet[0]]][..., [0, 2]].astype(np.float64)
  steps = np.linalg.norm(np.diff(ankles, axis=0), axis=-1).min(1) * motion.fps * skeleton.unit
  slides = [steps[max(first - 1, 0):past].mean() for first, past in motion.meta["made"] if len(steps)]
  return float(np.clip(max(slides, default=0.0) - _SLIDES, 0.0, 1.0))


def _glides(motion, requirements, checked):
  """[what is wrong] with new frames in which a body that makes no steps has to travel to the kept frames."""
  if not checked or any(one.kind == "run" for one in requirements) or not _skating(motion):
    return []
  first, past = max(motion.meta["made"], key=lambda span: span[1] - span[0])
  root = motion.joints[[max(first - 1, 0), min(past, len(motion.joints) - 1)], 0][:, [0, 2]]
  return [f"the feet slide, for the kept frames are {np.linalg.norm(root[1] - root[0]):.1f} m apart; say how the body "
          "gets there, as in \"walks forward, then ...\""]


def _spans(motion):
  """The joints of each new span in which something can be seen, or else of all of the motion."""
  spans = [motion.joints[first:past] for first, past in motion.meta["made"]]
  return [joints for joints in spans if len(joints) > _SHORTEST * motion.fps] or [motion.joints]


def _score(made, requirements, fps):
  """How far the new frames are from what is required, in the span that shows it best, and how distorted they are."""
  if not requirements:
    return made.distortion
  missed = min(looking.violation_score(joints, requirements, fps) for joints in _spans(made.motion))
  return missed + made.distortion


def _excess(made, requirements, fps):
  return min(looking.excess_speed(joints, requirements, fps) for joints in _spans(made.motion))


def _unmet(motion, requirements, fps):
  if not requirements:
    return []
  best = min(_spans(motion), key=lambda joints: looking.violation_score(joints, requirements, fps))
  return unmet_requirements(best, requirements, fps)
