"""How long each segment of a plan takes, in frames; and standing still where an action is over before its time is."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.analysis.event_words import TIMES
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float, require_numbers
from motion_jax_studio.language import Action, Plan, Segment, parse, pause
from motion_jax_studio.language.lexicon import COUNTED_ONE_BY_ONE, CYCLES, LOW, PAUSE
from motion_jax_studio.language.path_shapes import is_gait, min_duration
from motion_jax_studio.language.poses import hold
from motion_jax_studio.language.postures import postures_of

LONGEST = 3600     # seconds of a plan
_REST = 2.0        # seconds of standing still
_LEFT = 1.0        # seconds beyond an action's usual time from which on the body stands still
_AROUND = 1.5      # seconds in which a hand is raised and lowered, around repeated waves
_BRISK = 0.8       # share of its usual time that one repetition takes
# Limits of one repetition, in seconds. Clips of one squat among other exercises last seven seconds: of 24 motions with
# repeated kicks or squats 17 came out right with a limit of 3 s, 11 without one, 10 with 2.2 s. By its own lengths
# `cdamd-small` would give a kick 1.4 s and a squat 1.9 s, which is too short.
_LONGEST_REPETITION, _SHORTEST_REPETITION = 3.0, 2.4
_POSTURE = 2.5  # seconds in which a standing body takes a posture and keeps it
_ROUNDS = 3     # of a gesture that is made over and over, at least
# Least seconds to get down into a pose that is held. By its own lengths `cdamd-small` takes 0.9 to 1.6 s, and of 16
# seats the median trunk leans by 44 degrees; with 2.2 s it leans by 36, with 2.8 s by 24.
_GET_DOWN = 2.8


def usual_frames(planner: Any, plan: Plan) -> list[int]:
  """Frames of each segment: as the prompt says, or the usual length of its longest action, times its repetitions, at
  most the longest motion of the model."""
  counts: list[int] = []
  postures = postures_of(plan.segments)
  away = 0  # frames of the last walk or run, which the way back takes again
  for at, (segment, then) in enumerate(zip(plan.segments, (*plan.segments[1:], None))):
    beside = [postures.get((at, number), False) for number in range(1, len(segment.actions))]
    counts.append(round(segment.seconds * planner.fps) if segment.seconds else min(
        away if segment.action.goes_back and away else _segment_frames(planner, segment, then, beside),
        round(planner.model.max_seconds * planner.fps)))
    away = counts[-1] if is_gait(segment.action.verb) else away
  return counts


def _segment_frames(planner, segment, then, postures):
  """The usual length of a segment before another one. postures: of its simultaneous actions, False for no posture."""
  if segment.action.words == PAUSE and postures and False not in postures:
    return round(max(map(_posture_seconds, postures)) * planner.fps)
  if not segment.sampled:
    return round(_REST * planner.fps)
  return max(_least_frames(planner, segment, then), *(_action_frames(planner, one) for one in segment.sampled))


def _posture_seconds(place):
  """Seconds of a posture that a standing body takes, or of a gesture."""
  gesture = sum(seconds for _, seconds in place.gesture) if place else 0.0
  return max(_POSTURE, gesture * (_ROUNDS if place and place.rhythm else 1))


def _least_frames(planner, segment, then):
  """Least frames of a segment: time to get down into a pose that the next segment holds."""
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
  """Usual frames of an action that ends by itself, such as a kick; 0 of one that may go on, such as a walk."""
  plan = parse(prompt)
  done = plan.single is not None and plan.single.is_done_once
  return planner.natural_frames(prompt, plan.min_duration) if done else 0


def with_final_pause(planner: Any, plan: Plan | None, frames: float | None) -> Plan | None:
  """The plan, with standing still as its last segment where all its actions end by themselves and at least a second of
  the requested frames is left."""
  if plan is None or frames is None:
    return plan
  actions = [one for part in plan.segments for one in (part.action, *part.simultaneous)]
  if plan.is_plain:  # whose action is the text as it is
    actions = [plan.single]
  if any(part.seconds for part in plan.segments) or not all(one and one.leaves_at_ease for one in actions):
    return plan
  left = as_float(frames) / planner.fps - sum(usual_frames(planner, plan)) / planner.fps
  if not _LEFT <= left <= LONGEST:
    return plan
  return plan.with_segments((*plan.segments, pause(actions[-1].subject, left)))


def with_pauses(planner: Any, rows: Sequence[tuple[str, int]]) -> tuple[Plan, list[int]]:
  """(plan, frames of its segments) of (prompt, frames): an action that ends by itself is followed by standing still,
  and getting down by staying there, where a second or more of its frames is left."""
  segments, counts = [], []
  for prompt, count in rows:
    action = parse(prompt).single or Action(prompt, prompt)
    took = planner.natural_frames(prompt) if action.verb in LOW else frames_until_done(planner, prompt)
    left = (count - took) / planner.fps if took else 0.0
    segments.append(Segment(Action(prompt, prompt, action.part, verb=action.verb)))
    counts.append(took if left >= _LEFT else count)
    if left >= _LEFT:
      after = pause(action.subject if action.leaves_at_ease else "", left)
      segments.append(after._replace(action=hold(action.subject)) if action.verb in LOW else after)
      counts.append(count - took)
  return Plan(" | ".join(prompt for prompt, _ in rows), tuple(segments)), counts


def segment_frames(planner: Any, prompt: str, plan: Plan | None, frames: float | None) -> list[int]:
  """Frames of each segment of a plan, of the requested frames together (None: as long as they take); a single number
  for a prompt that goes to the network as it is. Raises InputError for a length that cannot be."""
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
  """Counts that sum to total; those the prompt gives stay as they are where that leaves enough for the others."""
  free = [count for count, given in zip(counts, is_given) if not given]
  left = total - sum(counts) + sum(free)
  if not free or left < least * len(free):
    return shared(counts, total, least)
  others = iter(shared(free, left, least))
  return [count if given else next(others) for count, given in zip(counts, is_given)]


def shared(usual: Sequence[int], total: int, least: int) -> list[int]:
  """Integers of at least `least` that sum to total, in proportion to the usual ones as far as that is possible."""
  ends = np.round(np.cumsum(usual) / sum(usual) * total).astype(int)
  lengths = np.diff([0, *ends])
  for i in np.flatnonzero(lengths < least):  # the longest gives up what is missing
    lengths[np.argmax(lengths)] -= least - lengths[i]
    lengths[i] = least
  return lengths.tolist()
