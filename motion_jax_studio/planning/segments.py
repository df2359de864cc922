"""Plans as prompts in sequence, for motion that is sampled in one run: streams, timelines, continued motions.

`sequencing` edits joints after sampling: it layers simultaneous actions and holds poses. A run in blocks cannot do
that, so here simultaneous actions share one prompt, and a pose is held by a prompt of the pose: under "a person sits
down" a body gets up again, under "a person is sitting on a chair" it stays. Other poses extend the prompt before them.
"""
from collections.abc import Sequence
from typing import Any

from motion_jax_studio.language import Plan, Segment
from motion_jax_studio.language.words import has_phrase, normalize
from motion_jax_studio.planning import durations

# Prompts of poses, after verbs that bring the body into them. With `cmdm-small`, 40 s after "sits down" and "lies down"
# all of 4 streams are still down, and without these prompts 0 and 1 of 4.
_POSES = {"sit": "is sitting on a chair", "lie": "is lying on the floor", "kneel": "is down on the knees"}
BLOCK = 12  # least frames of each action of a prompt with several


def prompts_in_sequence(planner: Any, plan: Plan, frames: float | None = None, least: int = BLOCK,
                        is_endless: bool = False) -> list[tuple[str, int | None]]:
  """[(prompt, frames)] of the actions of a plan; the text itself for a plan of one action.

  frames: of all actions together; None: their usual lengths, and None in the result for a single action. least: least
  frames of an action; a plan without room for that stays one prompt. is_endless: the last prompt continues without end,
  which is that of the pose where the last action ends in one.
  """
  rows = _rows(planner, plan, frames, least)
  held = _prompt_of_pose(planner, plan.read_segments[-1]) if is_endless else None
  if held is None:
    return rows
  prompt, count = rows[-1]
  return [*rows[:-1], (prompt, planner.natural_frames(prompt) if count is None else count), (held, None)]


def _rows(planner, plan, frames, least):
  if len(plan.segments) > 1 and (frames is None or frames >= least * len(plan.segments)):
    counts = durations.segment_frames(planner, plan.text, plan, frames)
    return [*_merged(planner, plan, [max(count, least) for count in counts] if frames is None else counts)]
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


def _merged(planner: Any, plan: Plan, counts: list[int]) -> list[tuple[str, int]]:
  """[(prompt, frames)] of the segments; those of one prompt are one."""
  rows: list[tuple[str, int]] = []
  for before, segment, count in zip((None, *plan.segments), plan.segments, counts):
    prompt = segment.prompt
    if before is not None and segment.hold_pose:
      prompt = _prompt_of_pose(planner, segment._replace(action=before.action)) or " and ".join(
          [rows[-1][0], *(action.words for action in segment.simultaneous)])
    if rows and rows[-1][0] == prompt:
      rows[-1] = prompt, rows[-1][1] + count
    else:
      rows.append((prompt, count))
  return rows


def _prompt_of_pose(planner: Any, segment: Segment) -> str | None:
  """The prompt of the pose in which a segment ends, with its simultaneous actions; None if it leaves the body standing
  or names a place, as "sits on the floor" does, or if the model does not know the words."""
  action = segment.action
  if action.verb not in _POSES or has_phrase(normalize(action.words), "on, in, at, against, up"):
    return None
  pose = f"{action.subject or 'a person'} {_POSES[action.verb]}"
  return None if planner.model.captions.unknown_words(pose) else " and ".join(
      [pose, *(other.words for other in segment.simultaneous)])
