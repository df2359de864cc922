"""Plans as prompts in sequence, for motion that is sampled in one run: streams, timelines, continued motions.

`sequencing` assembles what it samples from joints: simultaneous actions as layers, poses that are held. A run in blocks
cannot do that, so here simultaneous actions share one prompt, and a held pose is more time for the prompt before it.
"""
from collections.abc import Sequence
from typing import Any

from motion_jax_studio.language import Plan, Segment
from motion_jax_studio.planning import durations

BLOCK = 12  # frames that each of several actions of a prompt gets at least


def prompts_in_sequence(planner: Any, plan: Plan, frames: float | None = None, least: int = BLOCK
                        ) -> list[tuple[str, int | None]]:
  """[(prompt, frames)] of the actions of a plan; its text itself where it is one action.

  frames: of all of them together; None: each as long as usual, but None for a single action. least: frames below which
  no action gets; a plan whose actions would have less stays one prompt.
  """
  if len(plan.segments) > 1 and (frames is None or frames >= least * len(plan.segments)):
    counts = durations.segment_frames(planner, plan.text, plan, frames)
    return [*_merged(plan, [max(count, least) for count in counts] if frames is None else counts)]
  if len(plan.segments) > 1 or plan.segments[0].simultaneous or plan.is_plain:
    return [(plan.text, frames)]
  first = plan.segments[0]
  # "takes two bows" is "bows twice".
  return [(first.prompt, round(first.seconds * planner.fps) if frames is None and first.seconds else frames)]


def segments_of(planner: Any, segments: Sequence[tuple[str, float | None]], plan: bool = True
                ) -> list[tuple[str, int]]:
  """[(prompt, frames)] of the [(prompt, seconds or None)] of one motion: one for each action of a prompt's plan, or
  one for each prompt; None is the usual length."""
  model, found = planner.model, []
  for prompt, seconds in segments:
    frames = None if seconds is None else model.frames_of([prompt], None, seconds)[0]
    understood = planner.plan(prompt) if plan else None
    rows = prompts_in_sequence(planner, understood, frames) if understood else [(prompt, frames)]
    usual = lambda one, known=understood: planner.natural_frames(one, known.min_duration if known else 0.0)
    found += [(one, model.frames_of([one], usual(one) if count is None else count, None)[0]) for one, count in rows]
  return found


def _merged(plan: Plan, counts: list[int]) -> list[tuple[str, int]]:
  """The prompt of each segment; one that holds a pose continues the prompt before it."""
  found: list[tuple[str, int]] = []
  for segment, count in zip(plan.segments, counts):
    prompt = _prompt_of(segment, found[-1][0] if found else "")
    if found and found[-1][0] == prompt:
      found[-1] = prompt, found[-1][1] + count
    else:
      found.append((prompt, count))
  return found


def _prompt_of(segment: Segment, before: str) -> str:
  if not segment.hold_pose or not before:
    return segment.prompt
  return " and ".join([before, *(action.words for action in segment.simultaneous)])
