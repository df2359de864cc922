"""Segments that are sampled independently of one another and joined where their poses fit (`joining`).

So the frames of an earlier prompt do not suppress the next action. Several takes of each segment may be sampled; the
one that meets its requirements best is used, and repetitions of one prompt use different takes.
"""
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import jax
import numpy as np

from motion_jax.models.results import Motion, captions_in_a_row, features_of
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.step_records import largest, record
from motion_jax_studio.checks.best_of import best_of
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.language.requirements import Requirement, exactly_once, is_counted
from motion_jax_studio.planning.joining import SLACK, joined

_SEGMENT = 1 << 21  # added to a segment's place, so that its key differs from those of layers
_TAKE = 1 << 22     # added to a take's number, so that its key differs from all others
_AS_GOOD = 0.5      # most by which the violation score of a take that is used exceeds the best


def sample_independently(model: Any, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array,
                         seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], takes: int = 1,
                         required: Mapping[str, Sequence[Requirement]] = MappingProxyType({})) -> list[Motion]:
  """A Motion of each list of (prompt, frames): each segment is sampled alone and joined to the next where their poses
  fit, up to 14 frames earlier or later.

  takes: samples of each segment, of which `best_takes` are used; required: {prompt: requirements} to score takes by.
  Some lists are sampled in sequence instead: those of a single segment, those with a segment that is too long for the
  model, and those that repeat one prompt, unless several takes of it can be counted.
  """
  motions: dict[int, Motion] = {}
  longest = model.max_seconds * model.fps - SLACK
  rows = [row for row, segments in enumerate(lists)
          if max(count for _, count in segments) > longest or len(segments) == 1
          or len({prompt for prompt, _ in segments}) == 1 and not (
              takes > 1 and is_counted(required.get(segments[0][0], ())))]
  if rows:
    motions |= zip(rows, model.sample_segments([lists[row] for row in rows], keys[np.array(rows)],
                                             [seeds[row] for row in rows], cleanup, sampling))
  flat = [(row, place, number) for row, segments in enumerate(lists) if row not in motions
          for place in range(len(segments)) for number in range(takes)]
  if not flat:
    return [motions[row] for row in range(len(lists))]
  folded = jax.numpy.stack([take_key(jax.random.fold_in(keys[row], _SEGMENT + place), number)
                            for row, place, number in flat])
  samples = iter(model.sample([lists[row][place][0] for row, place, _ in flat],
                              [lists[row][place][1] + SLACK for row, place, _ in flat], folded,
                              [seeds[row] for row, *_ in flat], cleanup, sampling))
  sampled = {row: [[next(samples) for _ in range(takes)] for _ in lists[row]]
             for row in dict.fromkeys(row for row, *_ in flat)}
  for row, parts in sampled.items():
    best = best_takes(parts, lists[row], required, model.fps, model.stats.layout.skeleton)
    motions[row] = _joined(model, lists[row], best)
  return [motions[row] for row in range(len(lists))]


def take_key(key: jax.Array, number: int) -> jax.Array:
  """The key of take `number` of a sample with this key; take 0 has the key itself."""
  return jax.random.fold_in(key, _TAKE + number) if number else key


def best_takes(takes: Sequence[Sequence[Motion]], segments: Sequence[tuple[str, int]],
               required: Mapping[str, Sequence[Requirement]], fps: float, skeleton: Skeleton = HUMANML3D
               ) -> list[Motion]:
  """The take of each segment (prompt, frames) with the lowest violation score; the first of equal ones.

  Segments with the same prompt share their takes, and use one twice only if all others score clearly worse.
  """
  if skeleton is not HUMANML3D:
    return [segment_takes[0] for segment_takes in takes]
  wanted = {prompt: exactly_once(required.get(prompt, ())) for prompt, _ in segments}

  def score(row, motion):
    prompt, count = segments[row]
    return violation_score(motion.joints[:count], wanted[prompt], fps)

  bests = best_of(lambda rows, number, _: [(takes[row][number], {}) for row in rows], score, len(takes), len(takes[0]),
                  until=-1)
  pools: dict[str, list[tuple[float, Motion]]] = {}
  for (prompt, _), row in zip(segments, bests):
    pools.setdefault(prompt, []).extend((attempt.score, attempt.sample) for attempt in row.attempts)
  ready = {prompt: _in_turn(pool) for prompt, pool in pools.items()}
  return [next(ready[prompt]) for prompt, _ in segments]


def _in_turn(pool):
  """Cycle through the good takes of [(score, motion)], best first."""
  ordered = sorted(pool, key=lambda scored: scored[0])
  good = [motion for score, motion in ordered if score <= ordered[0][0] + _AS_GOOD]
  while True:
    yield from good


def _joined(model, segments, parts):
  joints, ends = joined([part.joints for part in parts], np.cumsum([count for _, count in segments]).tolist(),
                        model.stats.layout.skeleton)
  joints, prompts = joints.astype(np.float32), [prompt for prompt, _ in segments]
  cleaned = [step for part in parts for step in part.meta.get("steps", ()) if step["step"] == "cleanup"]
  steps = [record("sample", f"{len(parts)} prompts sampled independently and joined where poses meet"),
           *([largest(cleaned)] if cleaned else [])]
  return parts[0].replace(
      joints=joints, features=features_of(model, joints), captions=captions_in_a_row(prompts, ends, model.fps),
      meta=parts[0].meta | dict(prompt=" | ".join(prompts), way="joined", steps=steps))
