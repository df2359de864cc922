"""Sample plans: segments in sequence by the model's own method, simultaneous actions as layers on one body.

Simultaneous actions are sampled as motions of the same length; arms, head or torso of one replace those of the other
(`assembly`). Postures are not sampled, the pose step adds them (`posing`). A plain plan is one pass of the network with
the prompt as it was written.
"""
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np

from motion_jax.models.results import Motion, captions_in_a_row, features_of
from motion_jax.motion.step_records import added, record
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.hand_places import postures_of
from motion_jax_studio.language.lexicon import COUNTED_ONE_BY_ONE
from motion_jax_studio.language.requirements import Requirement, is_counted, requirements_of
from motion_jax_studio.planning import assembly, durations
from motion_jax_studio.planning.independent import best_takes, sample_independently, take_key
from motion_jax_studio.planning.job import Job

_TAKES = 3  # of each segment that is sampled independently


def sample(job: Job, independent: bool = False) -> list[Motion]:
  """Sample a motion of each plan of a job, and fill in `job.scheduled`; a prompt with a plain plan, or none, takes one
  pass.

  independent: sample segments, and repetitions of one action, independently with three takes each, and join the best
  (`planning.independent`).
  """
  model, planner = job.model, job.planner
  plans = [_split_repetitions(plan) for plan in job.plans] if independent else job.plans
  plans = [durations.with_final_pause(planner, plan, count) for plan, count in zip(plans, job.frames)]
  lengths = [durations.segment_frames(planner, *row) for row in zip(job.prompts, plans, job.frames)]
  job.scheduled = plans
  plain = [i for i, plan in enumerate(plans) if plan is None or plan.is_plain]
  motions: dict[int, Motion] = {}
  if plain:
    part = job.select(plain)
    motions |= zip(plain, model.sample(part.prompts, [lengths[i][0] for i in plain], part.keys, part.seeds, job.cleanup,
                                     job.sampling))
  rest = [i for i in range(len(plans)) if i not in motions]
  if rest:
    part = job.select(rest, plans=[plans[i] for i in rest])
    make, takes = (partial(sample_independently, model, takes=_TAKES, required=_required(part.plans)), _TAKES) if (
        independent) else (model.sample_segments, 1)
    motions |= zip(rest, compose(part, [lengths[i] for i in rest], make, takes))
  return [motions[i] for i in range(len(plans))]


def _split_repetitions(plan):
  """The plan; fully split if it is a caption with counted repetitions, for sampling the caption has failed already."""
  counts = plan is not None and plan.is_plain and any(requirement.counted for requirement in plan.requirements)
  return plan.fully_split() if counts else plan


def compose(job: Job, lengths: Sequence[Sequence[int]], sample_segments: Callable, takes: int = 1) -> list[Motion]:
  """Sample and assemble a motion of each plan. lengths: frames of its segments.

  sample_segments(lists of (prompt, frames), keys, seeds, cleanup, sampling) -> motions. takes: samples of each
  simultaneous action, the best of which is used; if more than 1, each repetition of a countable action is one segment.
  """
  model, plans, skeleton = job.model, job.plans, job.model.stats.layout.skeleton
  moving = [[(segment, count) for segment, count in zip(plan.segments, frames) if not segment.is_pause]
            or [(plan.segments[0], frames[0])] for plan, frames in zip(plans, lengths)]
  repetitions = [[repeated(segment.action, count, model.frames_per_latent, takes > 1) for segment, count in row]
                 for row in moving]
  bases = sample_segments([sum(row, []) for row in repetitions], job.keys, job.seeds, job.cleanup, job.sampling)
  spans = [spans_of(base, [len(segment) for segment in row]) for base, row in zip(bases, repetitions)]
  layers = _sample_layers(job, lengths, spans, takes)
  bodies = [assembly.assemble(base.joints, plan.segments, span, frames,
                              [layers.get((row, place), []) for place in range(len(plan.segments))], skeleton)
            for row, (base, plan, span, frames) in enumerate(zip(bases, plans, spans, lengths))]
  layered = [[action.words for place in range(len(plan.segments)) for action, _ in layers.get((row, place), ())]
             for row, plan in enumerate(plans)]
  return [_with_captions(model, *parts) for parts in zip(bases, plans, layered, bodies)]


def repeated(action: Any, count: int, least: int, one_by_one: bool = False) -> list[tuple[str, int]]:
  """[(prompt, frames)] of an action: a single one, or one for each repetition if these are sampled one by one."""
  single = action.verb in COUNTED_ONE_BY_ONE or one_by_one and is_counted(single_requirements(action))
  if action.times == 1 or not single or count < action.times * least:
    return [(action.prompt_with_count, count)]
  return [(action.prompt, part) for part in durations.shared([1] * action.times, count, least)]


def single_requirements(action: Action) -> list[Requirement]:
  """What one repetition of an action requires."""
  return requirements_of((action.replace(times=1),), action.prompt)


def _required(plans):
  """{prompt: requirements} of all actions of plans, by the prompts with which they are sampled."""
  actions = [action for plan in plans for segment in plan.segments for action in segment.actions]
  return {action.prompt_with_count: requirements_of((action,), action.prompt_with_count) for action in actions} | {
      action.prompt: single_requirements(action) for action in actions}


def spans_of(base: Motion, sizes: Sequence[int]) -> list[tuple[int, int]]:
  """[(first frame, frame past the last)] of segments, from the motion's captions. sizes: captions of each segment."""
  if sum(sizes) == 1:
    return [(0, base.num_frames)]
  ends = np.cumsum(sizes)
  frame = lambda seconds: min(round(seconds * base.fps), base.num_frames)
  return [(frame(base.captions[end - size].start), frame(base.captions[end - 1].end)) for end, size in zip(ends, sizes)]


def _sample_layers(job, lengths, spans, takes):
  """{(row, segment): [(action, joints)]} of the actions that are layered on segments."""
  model, rows = job.model, [plan.segments for plan in job.plans]
  postures = [postures_of(segments) if can_be_checked(model) else () for segments in rows]
  layers = [(row, place, number, segments[place].actions[at]) for row, segments in enumerate(rows)
            for number, (place, at) in enumerate(
                (place, at) for place, segment in enumerate(segments) for at in range(1, len(segment.actions)))
            if (place, at) not in postures[row]]
  sampled_layers: dict[tuple[int, int], list[Any]] = {}
  if not layers:
    return sampled_layers
  # Numbered within their plan, so that draws do not depend on other plans of the batch.
  flat = [(row, number, take) for row, _, number, _ in layers for take in range(takes)]
  keys = jax.numpy.stack([take_key(jax.random.fold_in(job.keys[row], 1 + number), take) for row, number, take in flat])
  parts = [(action.prompt_with_count, max(_layer_frames(rows[row], place, spans[row], lengths[row]),
                                          model.frames_per_latent)) for row, place, _, action in layers]
  motions = model.sample([prompt for prompt, _ in parts for _ in range(takes)],
                      [count for _, count in parts for _ in range(takes)], keys, [None] * len(flat), job.cleanup,
                      job.sampling)
  required = _required(job.plans)
  for number, (row, place, _, action) in enumerate(layers):
    best, = best_takes([motions[number * takes:(number + 1) * takes]], [parts[number]], required, model.fps,
                       model.stats.layout.skeleton)
    sampled_layers.setdefault((row, place), []).append((action, best.joints))
  return sampled_layers


def _layer_frames(segments, place, spans, lengths):
  """Frames of a layer, which are those of its segment; spans: of the segments that move."""
  if segments[place].is_pause:
    return lengths[place]
  first, past = spans[sum(not segment.is_pause for segment in segments[:place])]
  return past - first


def describe_plan(plan: Plan, frames: Sequence[int], fps: float) -> str:
  """A readable plan: "walks forward (3.2 s) | waves the right hand (2.6 s)"."""
  return " | ".join(f"{segment.words} ({count / fps:.1f} s)" for segment, count in zip(plan.segments, frames))


def _with_captions(model, base, plan, layered, body):
  """The motion with a caption per segment, its plan in meta["understood"], and features of its joints."""
  joints, spans = body
  captions = captions_in_a_row([segment.prompt for segment in plan.segments], [past for _, past in spans], model.fps)
  meta = base.meta | dict(prompt=plan.text, understood=describe_plan(plan, [b - a for a, b in spans], model.fps))
  if joints is base.joints:
    return base.replace(captions=captions, meta=meta)
  pauses = any(segment.is_pause for segment in plan.segments)
  did = " and ".join([f"body parts of {', '.join(layered)} layered"] * bool(layered) + ["pauses inserted"] * pauses)
  # A pause shifts later frames, so that a comparison frame by frame would mean nothing.
  done = record("sample", did) | {"num_frames": [base.num_frames, len(joints)]} if pauses else (
      record("sample", did, base.joints, joints, base.skeleton))
  return base.replace(joints=joints, features=features_of(model, joints), captions=captions, meta=added(meta, done))
