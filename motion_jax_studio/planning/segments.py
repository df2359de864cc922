"""Plans as prompts in sequence, for motion that is sampled in one run: streams, timelines, continued motions.

`sequencing` edits joints after sampling: it layers simultaneous actions and holds poses. A run in blocks cannot do
that, so here simultaneous actions share one prompt, and a held pose extends the prompt before it.
"""
from collections.abc import Sequence
from typing import Any

from motion_jax_studio.language import Plan, Segment
from motion_jax_studio.planning import durations

BLOCK = 12  # least frames of each action of a prompt with several


def prompts_in_sequence(planner: Any, plan: Plan, frames: float | None = None, least: int = BLOCK
                        ) -> list[tuple[str, int | None]]:
  """[(prompt, frames)] of the actions of a plan; the text itself for a plan of one action.

  frames: of all actions together; None: their usual lengths, and None in the result for a single action. least: least
  frames of an action; a plan without room for that stays one prompt.
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
  """[(prompt, frames)] from the [(prompt, seconds)] of one motion, one for each action of the prompts' plans.

  seconds None: the usual length. plan False: one for each prompt.
  """
  model, result = planner.model, []
  for prompt, seconds in segments:
    frames = None if seconds is None else model.frames_of([prompt], None, seconds)[0]
    understood = planner.plan(prompt) if plan else None
    rows = prompts_in_sequence(planner, understood, frames) if understood else [(prompt, frames)]
    min_seconds = understood.min_duration if understood else 0.0
    for text, count in rows:
      usual = planner.natural_frames(text, min_seconds) if count is None else count
      result.append((text, model.frames_of([text], usual, None)[0]))
  return result


def _merged(plan: Plan, counts: list[int]) -> list[tuple[str, int]]:
  """[(prompt, frames)] of the segments; a held pose extends the prompt before it."""
  rows: list[tuple[str, int]] = []
  for segment, count in zip(plan.segments, counts):
    prompt = _prompt_of(segment, rows[-1][0] if rows else "")
    if rows and rows[-1][0] == prompt:
      rows[-1] = prompt, rows[-1][1] + count
    else:
      rows.append((prompt, count))
  return rows


def _prompt_of(segment: Segment, before: str) -> str:
  if not segment.hold_pose or not before:
    return segment.prompt
  return " and ".join([before, *(action.words for action in segment.simultaneous)])
