"""The steps of a pipeline. Each takes a `Job`, a batch of requested motions, and fills in its part.

A step of your own is any function of a job; it stands in the list where it is to run.
"""
import dataclasses
import warnings

from motion_jax.models.results import Motion
from motion_studio import constraining
from motion_studio.checks import MAX_ATTEMPTS, prompt_notes, resampling
from motion_studio.checks.violations import can_be_checked
from motion_studio.constraining import is_constrained
from motion_studio.planning import path_ends, sequencing
from motion_studio.planning.job import Job


@dataclasses.dataclass(frozen=True)
class Plan:
  """Parses each prompt, once, into segments and simultaneous actions. Without it prompts go to the network as given."""

  def __call__(self, job: Job) -> None:
    plans = [plan or job.planner.plan(prompt) for prompt, plan in zip(job.prompts, job.plans)]
    # Constraints guide the sampling of a plain plan, which therefore stays one.
    job.plans = [plan if is_constrained(constraints) else job.planner.with_postures(plan)
                 for plan, constraints in zip(plans, job.constraints)]


@dataclasses.dataclass(frozen=True)
class Warn:
  """Warns of words and actions of the prompts that the model has not learned, with suggestions."""

  def __call__(self, job: Job) -> None:
    prompts = dict(zip(job.prompts, job.plans))
    for note in prompt_notes.notes_of(job.planner, [plan or text for text, plan in prompts.items()]) if (
        job.warns) else ():
      warnings.warn(note, stacklevel=3)


@dataclasses.dataclass(frozen=True)
class CleanUp:
  """Pins standing feet and removes tremor (`motion.cleanup`), in every sampled motion before it is joined to others.

  It stands before the step that samples.
  """

  def __call__(self, job: Job) -> None:
    job.cleanup = True


@dataclasses.dataclass(frozen=True)
class Sample:
  """Samples a motion of each plan: one pass for each part, which are joined.

  A plan of one action is guided towards its constraints, where the method can be guided.
  """

  def __call__(self, job: Job) -> None:
    _set_targets(job)
    groups: dict[str, list[int]] = {"free": [], "constrained": [], "guided": []}
    for i, target in enumerate(job.targets):
      groups["free" if target is None else "guided" if _is_guided(job, i) else "constrained"].append(i)
    found: dict[int, Motion] = {}
    for name, rows in groups.items():
      if rows:
        part = job.select(rows)
        found |= zip(rows, constraining.sample_job(part, part.targets) if name == "guided" else sequencing.sample(part))
    job.motions = [found[i] for i in range(len(job.prompts))]


def _set_targets(job):
  """What each constrained motion has to meet, and the lengths of all."""
  if not any(map(is_constrained, job.constraints)):
    return
  constraining.check_skeleton(job.model)
  rows = [i for i, one in enumerate(job.constraints) if is_constrained(one)]
  counts = {i: constraining.target_frames(job.planner, job.prompts[i], job.plans[i], job.constraints[i])
            if job.frames[i] is None else job.frames[i] for i in rows}
  for i in rows:
    plan = job.plans[i]
    if plan is not None and isinstance(job.constraints[i], list):
      job.notes[i] = path_ends.note_of(plan, job.constraints[i])
  for note in dict.fromkeys(filter(None, job.notes)) if job.warns else ():
    warnings.warn(note, stacklevel=4)
  for i in rows:
    job.targets[i] = constraining.target_of(job.constraints[i], int(round(counts[i])), job.planner.fps, job.exact)
    job.frames[i] = job.targets[i].frames_to_sample(job.planner.fps)


def _is_guided(job, i):
  plan = job.plans[i]
  return job.targets[i] is not None and job.model.takes_control and (plan is None or plan.is_plain)


@dataclasses.dataclass(frozen=True)
class Check:
  """Scores each motion by what its plan requires, and samples those that violate it again: best of `max_attempts`.

  Motions without a plan, and those that are guided towards constraints, are not checked.
  """
  max_attempts: int = MAX_ATTEMPTS

  def __call__(self, job: Job) -> None:
    rows = [i for i, plan in enumerate(job.plans) if plan is not None and not _is_guided(job, i)]
    if not rows or self.max_attempts == 1 or not can_be_checked(job.model):
      return
    part = job.select(rows)
    for i, motion in zip(rows, resampling.best_of(part, sequencing.sample, self.max_attempts)):
      job.motions[i] = motion


@dataclasses.dataclass(frozen=True)
class Constrain:
  """Brings each motion to its constraints: placed in the world, kept parts put back, projected, made a loop."""

  def __call__(self, job: Job) -> None:
    for i, target in enumerate(job.targets):
      if target is None:
        continue
      if not _is_guided(job, i) and job.plans[i] is not None and isinstance(target.constraints, list):
        # The words alone decided when the body has reached the end of its path.
        target = target._replace(constraints=path_ends.with_stop(target.constraints, job.motions[i], job.plans[i]))
      job.motions[i] = constraining.constrain(job.model, job.motions[i], target, job.exact)
