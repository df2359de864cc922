"""The steps of a pipeline: each takes a `Job`, a batch of requested motions, changes it, and records its changes
(`motion.step_records`).

Any function of a job can be a step of your own. Steps run in the order of the list, and are left out by name.
"""
import dataclasses
import warnings
from collections.abc import Callable, Sequence
from typing import ClassVar

from motion_jax.models.results import Motion
from motion_jax.motion.step_records import added, record
from motion_jax_studio import constraining, resampling
from motion_jax_studio.checks import MAX_ATTEMPTS, prompt_notes
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.constraining import is_constrained
from motion_jax_studio.planning import sequencing
from motion_jax_studio.planning.job import Job, plan_records
from motion_jax_studio.posing import path_ends
from motion_jax_studio.posing.corrections import corrected
from motion_jax_studio.posing.postures import posed


def name_of(step: Callable[[Job], None]) -> str:
  """The name of a step, for `without`."""
  return getattr(step, "name", None) or getattr(step, "__name__", type(step).__name__)


@dataclasses.dataclass(frozen=True)
class PlanPrompts:
  """Parses each prompt, once, into segments and simultaneous actions. Without it prompts go to the network as given."""
  name: ClassVar = "plan"

  def __call__(self, job: Job) -> None:
    plans = [plan or job.planner.plan(prompt) for prompt, plan in zip(job.prompts, job.plans)]
    # No postures with constraints: only plain plans are guided by them, so a plain plan must stay plain.
    job.plans = [plan if is_constrained(constraints) else job.planner.with_postures(plan)
                 for plan, constraints in zip(plans, job.constraints)]
    job.records = list(map(plan_records, job.plans))


@dataclasses.dataclass(frozen=True)
class Warn:
  """Warns of words and actions of the prompts that the model has not learned, with suggestions."""
  name: ClassVar = "warn"

  def __call__(self, job: Job) -> None:
    prompts = dict(zip(job.prompts, job.plans))
    for note in prompt_notes.notes_on(job.planner, [plan or text for text, plan in prompts.items()]) if (
        job.warns) else ():
      warnings.warn(note, stacklevel=3)


@dataclasses.dataclass(frozen=True)
class CleanUp:
  """Pins standing feet and removes tremor (`motion.cleanup`) in every sampled motion, before it is joined to others.

  It only sets `job.cleanup` for Sample, so it must come before that step.
  """
  name: ClassVar = "cleanup"

  def __call__(self, job: Job) -> None:
    job.cleanup = True


@dataclasses.dataclass(frozen=True)
class Sample:
  """Samples a motion of each plan: one pass for each part; the parts are then joined.

  A plan of one action is guided towards its constraints, where the method can be guided.
  """
  name: ClassVar = "sample"

  def __call__(self, job: Job) -> None:
    _set_targets(job)
    sampled: dict[int, Motion] = {}
    for guided in (False, True):
      for constrained in (False, True):
        rows = [i for i, target in enumerate(job.targets)
                if job.guided[i] == guided and (target is not None) == constrained]
        if rows:
          part = job.select(rows)
          motions = constraining.sample_job(part, part.targets) if guided else sequencing.sample(part, job.independent)
          sampled |= zip(rows, motions)
          for i, plan in zip(rows, part.scheduled):
            job.scheduled[i] = plan
    motions = [sampled[i] for i in range(len(job.prompts))]
    job.motions = [motion.replace(meta=motion.meta | {"steps": [*records, *motion.meta.get("steps", ())]})
                   for motion, records in zip(motions, job.records)]


def _set_targets(job):
  """Set targets, frames, notes and `guided` of the motions with constraints."""
  rows = [i for i, constraints in enumerate(job.constraints) if is_constrained(constraints) and job.targets[i] is None]
  if not rows:
    return
  constraining.check_skeleton(job.model)
  counts = {i: constraining.target_frames(job.planner, job.prompts[i], job.plans[i], job.constraints[i])
            if job.frames[i] is None else job.frames[i] for i in rows}
  for i in rows:
    plan = job.plans[i]
    if plan is not None and isinstance(job.constraints[i], list):
      job.notes[i] = path_ends.path_note(plan, job.constraints[i])
  for note in dict.fromkeys(filter(None, job.notes)) if job.warns else ():
    warnings.warn(note, stacklevel=4)
  for i in rows:
    job.targets[i] = constraining.target_of(job.constraints[i], int(round(counts[i])), job.planner.fps, job.exact)
    spare = any(isinstance(step, Constrain) for step in job.steps)  # sample more frames, to search for a loop in them
    job.frames[i] = job.targets[i].frames_to_sample(job.planner.fps) if spare else job.targets[i].count
    job.guided[i] = job.model.takes_control and (job.plans[i] is None or job.plans[i].is_plain)


@dataclasses.dataclass(frozen=True)
class Pose:
  """Turns walks to their side, leans the trunk and brings hands to where a plan has them (`posing.postures`).

  Motions without a plan, and those that are guided towards constraints, stay as they are.
  """
  name: ClassVar = "pose"

  def __call__(self, job: Job) -> None:
    for i, plan in enumerate(job.scheduled):
      if plan is not None and not job.guided[i] and can_be_checked(job.model):
        _changed(job, i, self.name, posed(job.model, job.motions[i], plan))


@dataclasses.dataclass(frozen=True)
class Correct:
  """Corrects motions that nearly meet what their plans require (`posing.corrections`): left and right are
  exchanged, a seated pose is kept, walks are bent to their shape.

  Motions without a plan, and those that are guided towards constraints, stay as they are.
  """
  name: ClassVar = "correct"

  def __call__(self, job: Job) -> None:
    for i, (plan, requirements) in enumerate(zip(job.plans, job.requirements)):
      if plan is not None and not job.guided[i] and can_be_checked(job.model):
        _changed(job, i, self.name, corrected(job.model, job.motions[i], requirements))


def _changed(job, row, step, motion):
  """Set the motion that a step returned, with a record of no change if it is the same object."""
  if motion is job.motions[row]:
    motion = motion.replace(meta=added(motion.meta, record(step, "nothing to change")))
  job.motions[row] = motion


@dataclasses.dataclass(frozen=True)
class Check:
  """Scores each motion by what its plan requires, and samples those that violate it again: best of `max_attempts`.

  Motions without a plan, and those that are guided towards constraints, are not checked.
  """
  max_attempts: int = MAX_ATTEMPTS
  name: ClassVar = "check"

  def __call__(self, job: Job) -> None:
    rows = [i for i, plan in enumerate(job.plans) if plan is not None and not job.guided[i]]
    if not rows or self.max_attempts == 1 or not can_be_checked(job.model):
      return
    resampling_steps = [step for step in job.steps or (Sample(), Pose(), Correct())
                        if isinstance(step, Sample | Pose | Correct)]

    def sample(again: Job) -> Sequence[Motion]:
      for step in resampling_steps:
        step(again)
      return again.motions

    for i, motion in zip(rows, resampling.resampled(job.select(rows), sample, self.max_attempts)):
      job.motions[i] = motion


@dataclasses.dataclass(frozen=True)
class Constrain:
  """Brings each motion to its constraints: placed in the world, kept parts put back, projected, made a loop."""
  name: ClassVar = "constrain"

  def __call__(self, job: Job) -> None:
    for i, target in enumerate(job.targets):
      if target is None:
        continue
      if not job.guided[i] and job.plans[i] is not None and isinstance(target.constraints, list):
        # Sampled without constraints, so the motion itself shows when the body stops at the end of its path.
        target = target._replace(constraints=path_ends.with_stop(target.constraints, job.motions[i], job.plans[i]))
      job.motions[i] = constraining.constrain(job.model, job.motions[i], target, job.exact)
