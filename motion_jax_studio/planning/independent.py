"""Segments that are sampled independently of one another and joined where their poses fit (`joining`).

No earlier segment holds the body back from the next action. Several takes of each action may be sampled, of which the
one that meets its requirements best is used; an action with repetitions gets as many different takes as it needs.
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
from motion_jax_studio.language.requirements import Requirement, is_counted, once
from motion_jax_studio.planning.joining import SLACK, joined

_SEGMENT = 1 << 21  # added to a segment's place, so that its key differs from those of layers
_TAKE = 1 << 22     # added to the number of a further take
_AS_GOOD = 0.5      # a take whose violation score exceeds the best by more than this is not used


def sample_independently(model: Any, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array,
                         seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], takes: int = 1,
                         required: Mapping[str, Sequence[Requirement]] = MappingProxyType({})) -> list[Motion]:
  """A Motion of each list of (prompt, frames), every segment sampled by itself and joined to the next where poses fit,
  up to 14 frames earlier or later.

  takes: of each segment, of which `best_takes` are used; required: requirements of prompts, to score them by. A list
  is sampled in sequence after all where a segment would be longer than the model's motions or, with one take, where it
  repeats one action.
  """
  found: dict[int, Motion] = {}
  longest = model.max_seconds * model.fps - SLACK
  rows = [row for row, one in enumerate(lists) if max(count for _, count in one) > longest or len(one) == 1
          or len({prompt for prompt, _ in one}) == 1 and not (takes > 1 and is_counted(required.get(one[0][0], ())))]
  if rows:
    found |= zip(rows, model.sample_segments([lists[row] for row in rows], keys[np.array(rows)],
                                             [seeds[row] for row in rows], cleanup, sampling))
  flat = [(row, place, number) for row, one in enumerate(lists) if row not in found
          for place in range(len(one)) for number in range(takes)]
  if not flat:
    return [found[row] for row in range(len(lists))]
  folded = jax.numpy.stack([take_key(jax.random.fold_in(keys[row], _SEGMENT + place), number)
                            for row, place, number in flat])
  made = iter(model.sample([lists[row][place][0] for row, place, _ in flat],
                           [lists[row][place][1] + SLACK for row, place, _ in flat], folded,
                           [seeds[row] for row, *_ in flat], cleanup, sampling))
  sampled = {row: [[next(made) for _ in range(takes)] for _ in lists[row]]
             for row in dict.fromkeys(row for row, *_ in flat)}
  for row, parts in sampled.items():
    best = best_takes(parts, lists[row], required, model.fps, model.stats.layout.skeleton)
    found[row] = _joined(model, lists[row], best)
  return [found[row] for row in range(len(lists))]


def take_key(key: jax.Array, number: int) -> jax.Array:
  """The key of a take of what has this key: that of the first is the key itself."""
  return jax.random.fold_in(key, _TAKE + number) if number else key


def best_takes(takes: Sequence[Sequence[Motion]], segments: Sequence[tuple[str, int]],
               required: Mapping[str, Sequence[Requirement]], fps: float, skeleton: Skeleton = HUMANML3D
               ) -> list[Motion]:
  """Of the takes of each segment (prompt, frames) the one with the lowest violation score; of equals the first.

  A take that another segment with the same prompt uses is used again only where all others score clearly worse.
  """
  if skeleton is not HUMANML3D:
    return [own[0] for own in takes]
  wanted = {prompt: once(required.get(prompt, ())) for prompt, _ in segments}

  def score(row, motion):
    prompt, count = segments[row]
    return violation_score(motion.joints[:count], wanted[prompt], fps)

  found = best_of(lambda rows, number, _: [(takes[row][number], {}) for row in rows], score, len(takes), len(takes[0]),
                  until=-1)
  pools: dict[str, list[tuple[float, Motion]]] = {}
  for (prompt, _), row in zip(segments, found):
    pools.setdefault(prompt, []).extend((attempt.score, attempt.sample) for attempt in row.attempts)
  ready = {prompt: _in_turn(pool) for prompt, pool in pools.items()}
  return [next(ready[prompt]) for prompt, _ in segments]


def _in_turn(pool):
  """Yields the good takes of [(score, motion)], best first, again and again."""
  ordered = sorted(pool, key=lambda one: one[0])
  good = [motion for score, motion in ordered if score <= ordered[0][0] + _AS_GOOD]
  while True:
    yield from good


def _joined(model, segments, parts):
  joints, ends = joined([part.joints for part in parts], np.cumsum([count for _, count in segments]).tolist(),
                        model.stats.layout.skeleton)
  joints, prompts = joints.astype(np.float32), [prompt for prompt, _ in segments]
  cleaned = [one for part in parts for one in part.meta.get("steps", ()) if one["step"] == "cleanup"]
  steps = [record("sample", f"{len(parts)} prompts sampled independently and joined where poses meet"),
           *([largest(cleaned)] if cleaned else [])]
  return parts[0].replace(
      joints=joints, features=features_of(model, joints), captions=captions_in_a_row(prompts, ends, model.fps),
      meta=parts[0].meta | dict(prompt=" | ".join(prompts), way="joined", steps=steps))
