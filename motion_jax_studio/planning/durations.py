"""Durations of the segments of a plan, in frames; a pause fills the time that is left after an action."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.analysis.event_words import TIMES
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float, require_numbers
from motion_jax_studio.language import Action, Plan, Segment, parse, pause
from motion_jax_studio.language.actions import still
from motion_jax_studio.language.hand_places import postures_of
from motion_jax_studio.language.lexicon import COUNTED_ONE_BY_ONE, CYCLES, HOLD, LOW, PAUSE
from motion_jax_studio.language.path_shapes import is_gait, min_duration

LONGEST = 3600     # seconds of a plan
_REST = 2.0        # seconds of standing still
_LEFT = 1.0        # least seconds left after an action's usual time that become a pause
_AROUND = 1.5      # seconds in which a hand is raised and lowered, around repeated waves
_BRISK = 0.8       # share of an action's usual time that one of its repetitions takes
# Limits of one repetition, in seconds. Above: training clips of a squat last up to seven seconds, for they show other
# exercises too; of 24 motions with repeated kicks or squats, 17 were right with a limit of 3 s, 10 with 2.2 s, 11 with
# none. Below: the length estimates of `cdamd-small`, 1.4 s for a kick and 1.9 s for a squat, are too short.
_LONGEST_REPETITION, _SHORTEST_REPETITION = 3.0, 2.4
_POSTURE = 2.5  # seconds in which a standing body takes a posture and keeps it
_ROUNDS = 3     # least repetitions of a repeated gesture
# Least seconds to get down into a held pose. With its own estimates, 0.9 to 1.6 s, `cdamd-small` sits down with the
# trunk leaning by 44 degrees (median of 16 motions); with 2.2 s it leans by 36, with 2.8 s by 24.
_GET_DOWN = 2.8


def usual_frames(planner: Any, plan: Plan) -> list[int]:
  """Frames of each segment: those that the prompt states, else the usual length of its longest action with repetitions,
  at most the longest motion of the model."""
  counts: list[int] = []
  postures = postures_of(plan.segments)
  away = 0  # frames of the last walk or run, which the way back takes again
  for at, (segment, then) in enumerate(zip(plan.segments, (*plan.segments[1:], None))):
    layers = [postures.get((at, number), False) for number in range(1, len(segment.actions))]
    counts.append(round(segment.seconds * planner.fps) if segment.seconds else min(
        away if segment.action.goes_back and away else _segment_frames(planner, segment, then, layers),
        round(planner.model.max_seconds * planner.fps)))
    away = counts[-1] if is_gait(segment.action.verb) else away
  return counts


def _segment_frames(planner, segment, then, postures):
  """Usual frames of a segment. then: the next segment; postures: of its simultaneous actions, False for no posture."""
  if segment.action.words == PAUSE and postures and False not in postures:
    return round(max(map(_posture_seconds, postures)) * planner.fps)
  if not segment.sampled:
    return round(_REST * planner.fps)
  return max(_least_frames(planner, segment, then), *(_action_frames(planner, action) for action in segment.sampled))


def _posture_seconds(place):
  """Seconds of a posture of a standing body, or of a gesture."""
  gesture = sum(seconds for _, seconds in place.gesture) if place else 0.0
  return max(_POSTURE, gesture * (_ROUNDS if place and place.repeats else 1))


def _least_frames(planner, segment, then):
  """Least frames of a segment: the time to get down into a pose that the next segment holds."""
  return round(_GET_DOWN * planner.fps) if segment.action.verb in LOW and then is not None and then.hold_pose else 0


def _action_frames(planner, action):
  natural_frames = lambda prompt: planner.natural_frames(prompt, min_duration((action,)))
  if action.times > 1 and action.verb in COUNTED_ONE_BY_ONE:
    once = np.clip(_BRISK * natural_frames(action.prompt), _SHORTEST_REPETITION * planner.fps,
                   _LONGEST_REPETITION * planner.fps)
    return round(once) * action.times
  if action.times > 1:
    nearest = planner.nearest_captions(action.prompt_with_count)
    if nearest and TIMES.get(action.times, "no number") in nearest[0][0]:  # clips show as many repetitions
      return natural_frames(action.prompt_with_count)
    cycle = CYCLES.get(action.verb)
    if cycle is not None:
      return round((cycle * action.times + _AROUND) * planner.fps)
  return natural_frames(action.prompt) * action.times


def frames_until_done(planner: Any, prompt: str) -> int:
  """Usual frames of an action that ends by itself, such as a kick; 0 for one that can continue, such as a walk."""
  plan = parse(prompt)
  done = plan.single is not None and plan.single.is_done_once
  return planner.natural_frames(prompt, plan.min_duration) if done else 0


def with_final_pause(planner: Any, plan: Plan | None, frames: float | None) -> Plan | None:
  """The plan with a final pause, if all its actions end by themselves and a second or more of the requested frames is
  left."""
  if plan is None or frames is None:
    return plan
  actions = [action for part in plan.segments for action in (part.action, *part.simultaneous)]
  if plan.is_plain:  # its segment holds the text, not the parsed action
    actions = [plan.single]
  if any(part.seconds for part in plan.segments) or not all(action and action.leaves_at_ease for action in actions):
    return plan
  left = as_float(frames) / planner.fps - sum(usual_frames(planner, plan)) / planner.fps
  if not _LEFT <= left <= LONGEST:
    return plan
  return plan.with_segments((*plan.segments, pause(actions[-1].subject, left)))


def with_pauses(planner: Any, rows: Sequence[tuple[str, int]]) -> tuple[Plan, list[int]]:
  """(plan, frames of its segments) of rows (prompt, frames). Where a second or more is left, an action that ends by
  itself is followed by a pause, and getting down by a hold of the low pose."""
  segments, counts = [], []
  for prompt, count in rows:
    action = parse(prompt).single or Action(prompt, prompt)
    took = planner.natural_frames(prompt) if action.verb in LOW else frames_until_done(planner, prompt)
    left = (count - took) / planner.fps if took else 0.0
    segments.append(Segment(Action(prompt, prompt, action.part, verb=action.verb)))
    counts.append(took if left >= _LEFT else count)
    if left >= _LEFT:
      after = pause(action.subject if action.leaves_at_ease else "", left)
      segments.append(after._replace(action=still(action.subject, HOLD)) if action.verb in LOW else after)
      counts.append(count - took)
  return Plan(" | ".join(prompt for prompt, _ in rows), tuple(segments)), counts


def segment_frames(planner: Any, prompt: str, plan: Plan | None, frames: float | None) -> list[int]:
  """Frames of each segment of a plan; one number for a plain plan, and for a prompt without a plan.

  frames: of all segments together; None: their usual lengths. Raises InputError for a length out of range.
  """
  model = planner.model
  if plan is None or plan.is_plain:
    usual = lambda: planner.natural_frames(prompt, plan.min_duration if plan else 0.0)
    return model.frames_of([prompt], usual() if frames is None else frames, None)
  if frames is not None:
    require_numbers([frames], "num_frames", "a number, or one per prompt")
  counts, least = usual_frames(planner, plan), planner.frames_per_latent
  if frames is not None:
    total = as_float(frames)
    if not least * len(counts) <= total <= LONGEST * planner.fps:
      raise InputError(f"got a length of {total:g} frames for {len(counts)} actions in sequence, expected "
                       f"{least * len(counts)} to {LONGEST * planner.fps:,.0f}: {least * len(counts) / planner.fps:g} "
                       f"to {LONGEST:,} s at {planner.fps:g} frames a second")
    counts = fit_to(counts, [segment.seconds is not None for segment in plan.segments], round(total), least)
  if sum(counts) > LONGEST * planner.fps:
    raise InputError(f"got a sentence of {sum(counts) / planner.fps:,.0f} s, expected at most {LONGEST:,}")
  return model.frames_of([segment.action.prompt for segment in plan.segments], counts, None)


def fit_to(counts: Sequence[int], is_given: Sequence[bool], total: int, least: int) -> list[int]:
  """Counts that sum to `total`; those that the prompt states (`is_given`) stay if each other one can be `least`."""
  free = [count for count, given in zip(counts, is_given) if not given]
  left = total - sum(counts) + sum(free)
  if not free or left < least * len(free):
    return shared(counts, total, least)
  others = iter(shared(free, left, least))
  return [count if given else next(others) for count, given in zip(counts, is_given)]


def shared(usual: Sequence[int], total: int, least: int) -> list[int]:
  """Integers of at least `least` that sum to `total`, proportional to the usual ones as far as possible."""
  ends = np.round(np.cumsum(usual) / sum(usual) * total).astype(int)
  lengths = np.diff([0, *ends])
  for i in np.flatnonzero(lengths < least):  # the longest one gives the missing frames
    lengths[np.argmax(lengths)] -= least - lengths[i]
    lengths[i] = least
  return lengths.tolist()
