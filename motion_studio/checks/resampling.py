"""Best of n: motions that violate requirements of their prompts are sampled again, and the best attempt is kept."""
from collections.abc import Callable, Sequence
from typing import Any

import jax

from motion_jax.models.results import Motion
from motion_jax.utils import progress
from motion_studio.checks.reports import report, unmet_requirements
from motion_studio.checks.violations import excess_speed, violation_score
from motion_studio.language.path_shapes import with_explicit_side
from motion_studio.planning.finishing_touches import corrected
from motion_studio.planning.job import Job

LOUDER = 2.0  # factor on the guidance scale of another attempt; of 24 punches with a named hand 6 show without, 16 with
SOFTER = 0.5  # factor where a motion overdoes its prompt and violates nothing else
FIRST_RESAMPLED = 1 << 20  # added to an attempt's number, so that its key is unique
_INDEPENDENT = 2  # attempts before segments are sampled independently


def best_of(job: Job, sample: Callable[..., Sequence[Motion]], max_attempts: int) -> list[Motion]:
  """The motions of a job, each the best of its attempts by violation score, of equals the first.

  sample(job, independent=False) -> motions. A motion that violates a requirement is sampled again, by the key
  fold_in(key, 2^20 + attempt): with twice the guidance scale, or half of it where the motion is only too fast, with a
  side for a circle that has none, and from the third attempt on in plain words, with segments sampled independently.
  All attempts are recorded in meta["attempts"], what the best one still violates in meta["unmet"] and, where warnings
  are read, in a warning.
  """
  required = [plan.requirements if plan else [] for plan in job.plans]

  def scored(motions, rows):
    motions = [corrected(job.model, motion, required[i]) for i, motion in zip(rows, motions)]
    return [(violation_score(motion.joints, required[i], job.planner.fps), motion)
            for i, motion in zip(rows, motions)]

  everyone = range(len(job.prompts))
  best = scored(job.motions, everyone)
  attempts = [[_record(job, i, 0, score)] for i, (score, _) in enumerate(best)]
  kept = [0 for _ in best]

  def resample(rows, number, factor):
    keys = jax.numpy.stack([jax.random.fold_in(job.keys[i], FIRST_RESAMPLED + number) for i in rows])
    prompts = [said_again(job.prompts[i], required[i], number) for i in rows]
    plans = [job.plans[i] if prompt == job.prompts[i] else job.planner.with_postures(job.planner.plan(prompt))
             for i, prompt in zip(rows, prompts)]
    if number >= _INDEPENDENT:
      plans = [plan and job.planner.in_plain_words(plan) for plan in plans]
    again = job.select(rows, prompts=prompts, plans=plans, keys=keys,
                       sampling=reweighed(job.model, job.sampling, factor), motions=[])
    with progress.part(f"attempt {number + 1} of {max_attempts}, as the last motion does not show all of the prompt"):
      made = sample(again, number >= _INDEPENDENT)
    for place, (i, (score, motion)) in enumerate(zip(rows, scored(made, rows))):
      attempts[i].append(_record(again, place, number, score))
      if score < best[i][0]:
        best[i], kept[i] = (score, motion), number

  for number in range(1, max_attempts):
    rows = [i for i, (score, _) in enumerate(best) if score]
    if not rows:
      break
    # Too fast and nothing else; an action that does not show needs more guidance first.
    over = [i for i in rows if best[i][0] <= excess_speed(best[i][1].joints, required[i], job.planner.fps)]
    for some, factor in (([i for i in rows if i not in over], LOUDER), (over, SOFTER)):
      if some:
        resample(some, number, factor)
  motions = [motion for _, motion in best]
  unmet = [unmet_requirements(motion.joints, one, job.planner.fps) for motion, one in zip(motions, required)]
  if job.warns:
    report(job.prompts, unmet, max_attempts)
  motions = [motion.replace(meta=motion.meta | dict(prompt=prompt)) if missing else motion
             for prompt, motion, missing in zip(job.prompts, motions, unmet)]
  return [with_attempts(*one) for one in zip(motions, attempts, kept, unmet)]


def with_attempts(motion: Motion, attempts: Sequence[dict[str, Any]], kept: int, unmet: Sequence[str]) -> Motion:
  """The motion with the record of its attempts, of which number `kept` is this one, and requirements it violates."""
  found = [one | dict(kept=number == kept) for number, one in enumerate(attempts)]
  return motion.replace(meta=motion.meta | dict(attempts=found) | (dict(unmet=list(unmet)) if unmet else {}))


def _record(job, row, number, score):
  """An attempt as a motion's meta has it."""
  return dict(number=number + 1, seed=job.seeds[row], prompt=job.prompts[row],
              guidance_scale=guidance_scale(job.model, job.sampling), independent=number >= _INDEPENDENT,
              violation_score=round(float(score), 4))


def said_again(prompt: str, requirements: Sequence[Any], number: int) -> str:
  """The prompt of another attempt: a circle without a side gets one, as some models know only such circles."""
  either = any(one.kind == "circle" and not one.side for one in requirements)
  return with_explicit_side(prompt, number) if either else prompt


def guidance_scale(model: Any, sampling: dict[str, Any]) -> float:
  """The guidance scale that choices of sampling mean for a model: the one given, else its own."""
  given = sampling.get("guidance_scale")
  return float(model.sampling().guidance_scale if given is None else given)


def reweighed(model: Any, sampling: dict[str, Any], factor: float) -> dict[str, Any]:
  """The choices of sampling with the model's guidance scale times factor, but at least 1; unchanged where a scale is
  given, or the model has no guidance."""
  scale = guidance_scale(model, sampling)
  return sampling if scale <= 1 or sampling.get("guidance_scale") is not None else (
      dict(sampling) | dict(guidance_scale=max(factor * scale, 1.0)))
