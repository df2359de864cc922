"""Actions in a row of which each is made by itself; they are joined where poses fit (`motion.joining`).

No past holds a body back from what it is told then. Of each action several may be made, and looked at: the one that
shows it best is taken, and of an action that is done so many times as many as are needed.
"""
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.models.results import Motion, captions_in_a_row, features_of
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_studio.checks import requirements as looking
from motion_studio.planning.joining import SLACK, joined

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel

_PART = 1 << 21  # added to the place of an action in its row, so that its key is no layer's
_AGAIN = 1 << 22  # added to the number of another try at it
_AS_GOOD = 0.5   # of an action that is missed; what misses so much more than the best shows it less


def made_apart(model: "TextToMotionModel", lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array,
               seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], tries: int = 1) -> list[Motion]:
  """A Motion of each list of (prompt, frames), as `in_a_row`, but each made by itself and joined where poses fit, up to
  14 frames earlier or later.

  tries: how many are made of each action; which is taken is `best_parts`. In a row stays what would be longer than the
  model makes any and, with a single try, one action that is done several times.
  """
  found: dict[int, Motion] = {}
  longest = model.max_seconds * model.fps - SLACK
  rows = [row for row, one in enumerate(lists) if max(count for _, count in one) > longest or len(one) == 1
          or len({prompt for prompt, _ in one}) == 1 and not (tries > 1 and looking.is_counted(one[0][0]))]
  if rows:
    found |= zip(rows, model.in_a_row([lists[row] for row in rows], keys[np.array(rows)], [seeds[row] for row in rows],
                                      cleanup, sampling))
  flat = [(row, place, number) for row, one in enumerate(lists) if row not in found
          for place in range(len(one)) for number in range(tries)]
  if not flat:
    return [found[row] for row in range(len(lists))]
  folded = jax.numpy.stack([_key(keys[row], place, number) for row, place, number in flat])
  made = iter(model.sample([lists[row][place][0] for row, place, _ in flat],
                           [lists[row][place][1] + SLACK for row, place, _ in flat], folded,
                           [seeds[row] for row, *_ in flat], cleanup, sampling))
  tried = {row: [[next(made) for _ in range(tries)] for _ in lists[row]] for row in dict.fromkeys(r for r, *_ in flat)}
  for row, parts in tried.items():
    found[row] = _joined(model, lists[row], best_parts(parts, lists[row], model.fps, model.stats.layout.skeleton))
  return [found[row] for row in range(len(lists))]


def _key(key, place, number):
  key = jax.random.fold_in(key, _PART + place)
  return jax.random.fold_in(key, _AGAIN + number) if number else key


def best_parts(tried: Sequence[Sequence[Motion]], asked: Sequence[tuple[str, int]], fps: float,
               skeleton: Skeleton = HUMANML3D) -> list[Motion]:
  """Of the motions that were tried of each (prompt, frames) the one that shows best, in so many frames, what its prompt
  says is done, and once; of equals the first.

  One that another place of the same prompt has is taken again only where all others show it less.
  """
  if skeleton is not HUMANML3D:
    return [own[0] for own in tried]
  pools: dict[str, list[tuple[float, Motion]]] = {}
  for own, (prompt, count) in zip(tried, asked):
    wanted = looking.once(looking.requirements_of(prompt))
    pools.setdefault(prompt, []).extend(
        (looking.violation_score(motion.joints[:count], wanted, fps), motion) for motion in own)
  ready = {prompt: _in_turn(pool) for prompt, pool in pools.items()}
  return [next(ready[prompt]) for prompt, _ in asked]


def _in_turn(pool):
  """Of (missed, motion) those that miss the least, one after the other, and over again."""
  ordered = sorted(pool, key=lambda one: one[0])
  good = [motion for missed, motion in ordered if missed <= ordered[0][0] + _AS_GOOD]
  while True:
    yield from good


def _joined(model, asked, parts):
  joints, ends = joined([part.joints for part in parts], np.cumsum([count for _, count in asked]).tolist(),
                        model.stats.layout.skeleton)
  joints, prompts = joints.astype(np.float32), [prompt for prompt, _ in asked]
  return parts[0].replace(
      joints=joints, features=features_of(model, joints), captions=captions_in_a_row(prompts, ends, model.fps),
      meta=parts[0].meta | dict(prompt=" | ".join(prompts), way="joined"))
