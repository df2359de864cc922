"""Best-of-n sampling: motions that violate requirements of their prompts are resampled; the best attempt is kept."""
from collections.abc import Callable, Sequence
from typing import Any

import jax

from motion_jax.models.results import Motion
from motion_jax.motion.step_records import added, record
from motion_jax.utils import progress
from motion_jax_studio.checks.best_of import Attempt, Best, best_of
from motion_jax_studio.checks.reports import report, unmet_requirements
from motion_jax_studio.checks.violations import excess_speed, violation_score
from motion_jax_studio.language.path_shapes import with_explicit_side
from motion_jax_studio.planning.job import Job, plan_records

# Factors on the guidance scale of further attempts. LOUDER: of 24 punches with a named hand 16 are seen, 6 without it.
# SOFTER: for a motion that is only too fast, or distorted.
LOUDER, SOFTER = 2.0, 0.5
FIRST_RESAMPLED = 1 << 20  # added to an attempt's number, so that its key is unique
_INDEPENDENT = 2  # number of attempts before segments are sampled independently


def with_guidance(sample: Callable[[Sequence[int], int, float], Sequence[tuple[Any, dict[str, Any]]]],
                  overdoes: Callable[[int, int, Attempt], bool], max_attempts: int) -> Callable:
  """The `sample` function for `best_of`, from sample(rows, number, factor on the guidance scale).

  The factor is 1 in the first attempt, then `SOFTER` if overdoes(row, number, best attempt so far), else `LOUDER`.
  """

  def attempt(rows: Sequence[int], number: int, bests: Sequence[Best]) -> list[Any]:
    if not number:
      return list(sample(rows, 0, 1.0))
    softer = [i for i in rows if overdoes(i, number, bests[i].best)]
    samples: dict[int, Any] = {}
    for group, factor in (([i for i in rows if i not in softer], LOUDER), (softer, SOFTER)):
      if group:
        with progress.part(f"attempt {number + 1} of {max_attempts}, as the last one does not show all of the prompt"):
          samples |= zip(group, sample(group, number, factor))
    return [samples[i] for i in rows]

  return attempt


def resampled(job: Job, sample: Callable[[Job], Sequence[Motion]], max_attempts: int) -> list[Motion]:
  """The motions of a job, each the best of up to `max_attempts` by violation score.

  sample(job) -> motions, sampled, posed and corrected. A motion that violates a requirement is resampled with the key
  fold_in(key, 2^20 + attempt), and with these changes: twice the guidance scale (half, if the motion is only too fast);
  a side for a circle without one; from the third attempt on plain words, and segments sampled independently.
  meta["attempts"] records all attempts, meta["unmet"] what the best one still violates, which is also a warning.
  """
  requirements = job.requirements

  def attempts(rows, number, factor):
    part = _again(job, rows, number, factor) if number else job
    motions = sample(part) if number else job.motions
    return [(motion, attempt_record(part, place, number) | dict(independent=part.independent))
            for place, motion in enumerate(motions)]

  score = lambda row, motion: violation_score(motion.joints, requirements[row], job.planner.fps)
  # Only too fast; a missing action needs more guidance first.
  overdoes = lambda row, _, best: best.score <= excess_speed(best.sample.joints, requirements[row], job.planner.fps)
  bests = best_of(with_guidance(attempts, overdoes, max_attempts), score, len(job.prompts), max_attempts)
  motions = [row.best.sample for row in bests]
  unmet = [unmet_requirements(motion.joints, row, job.planner.fps) for motion, row in zip(motions, requirements)]
  if job.warns:
    report(job.prompts, unmet, max_attempts)
  motions = [with_attempts(*row) for row in zip(motions, bests, unmet)]
  return [motion.replace(meta=motion.meta | dict(prompt=prompt)) if missing else motion
          for prompt, motion, missing in zip(job.prompts, motions, unmet)]


def _again(job, rows, number, factor):
  """The job of another attempt."""
  requirements = job.requirements
  prompts = [reworded_prompt(job.prompts[i], requirements[i], number) for i in rows]
  plans = [job.plans[i] if prompt == job.prompts[i] else job.planner.with_postures(job.planner.plan(prompt))
           for i, prompt in zip(rows, prompts)]
  if number >= _INDEPENDENT:
    plans = [plan and job.planner.in_plain_words(plan) for plan in plans]
  return job.select(rows, prompts=prompts, plans=plans, keys=keys_again(job, rows, number), motions=[],
                    records=[plan_records(plan) for plan in plans],
                    sampling=reweighed(job.model, job.sampling, factor), independent=number >= _INDEPENDENT,
                    given_requirements=[requirements[i] for i in rows])


def keys_again(job: Job, rows: Sequence[int], number: int) -> jax.Array:
  """The keys of another attempt."""
  return jax.numpy.stack([jax.random.fold_in(job.keys[i], FIRST_RESAMPLED + number) for i in rows])


def with_attempts(motion: Motion, row: Best, unmet: Sequence[str], checked: bool = True) -> Motion:
  """The best motion with records of all attempts, of the check, and of the requirements that it violates."""
  attempts = [attempt.record | dict(violation_score=round(float(attempt.score), 4), kept=number == row.kept)
              for number, attempt in enumerate(row.attempts)]
  did = f"attempt {row.kept + 1} of {len(attempts)} kept"
  steps = [record("check", did, score=(row.attempts[0].score, row.best.score))] if checked else []
  return motion.replace(meta=added(motion.meta, *steps) | dict(attempts=attempts) | (
      dict(unmet=list(unmet)) if unmet else {}))


def attempt_record(job: Job, row: int, number: int) -> dict[str, Any]:
  """The record of an attempt in a motion's meta, without its score."""
  return dict(number=number + 1, seed=job.seeds[row], prompt=job.prompts[row],
              guidance_scale=guidance_scale(job.model, job.sampling))


def reworded_prompt(prompt: str, requirements: Sequence[Any], number: int) -> str:
  """The prompt of another attempt: a circle without a side gets one, because some models know no other circles."""
  either = any(requirement.kind == "circle" and not requirement.side for requirement in requirements)
  return with_explicit_side(prompt, number) if either else prompt


def guidance_scale(model: Any, sampling: dict[str, Any]) -> float:
  """The guidance scale among sampling choices, else the model's default."""
  given = sampling.get("guidance_scale")
  return float(model.sampling().guidance_scale if given is None else given)


def reweighed(model: Any, sampling: dict[str, Any], factor: float) -> dict[str, Any]:
  """The sampling choices with the model's guidance scale times `factor`, at least 1; unchanged if they have a scale, or
  if the model has no guidance."""
  scale = guidance_scale(model, sampling)
  return sampling if scale <= 1 or sampling.get("guidance_scale") is not None else (
      dict(sampling) | dict(guidance_scale=max(factor * scale, 1.0)))
