"""Motions of several prompts that are made anew only from where they changed.

A motion is made block by block by a stream. A copy of the stream is kept where each prompt begins and every few blocks
between; when prompts or lengths change, the last copy before the first block whose words are others goes on. What comes
before depends on nothing behind it (attention is causal, the cache is exact), so its frames are the same bit for bit,
but for the half second that the cleanup looks ahead.
"""
import collections
import hashlib
import threading
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm.multi_prompt import borders
from motion_jax.models.results import Motion, captions_in_a_row
from motion_jax.utils import progress

_EVERY = 8    # blocks between two copies of a stream, a megabyte each


class _Take:
  """What is known of the motion that was made last of one model, seed and way of sampling."""

  def __init__(self):
    self.words: list[str] = []  # of each block
    self.copies: dict[int, tuple[Any, int]] = {}  # by step: (stream before that step, frames that it had given)
    self.joints = np.zeros((0, 0, 3), np.float32)


class MultiPromptCache:
  """Makes motions of several prompts, each one action, and remembers how."""

  def __init__(self, max_motions: int = 6, max_copies: int = 150) -> None:
    """max_motions: how many motions keep their copies; max_copies: of all motions together, a megabyte each."""
    self._max_motions, self._max_copies = max_motions, max_copies
    self._takes: collections.OrderedDict[Any, _Take] = collections.OrderedDict()
    self._lock = threading.Lock()

  def make(self, model: Any, segments: Sequence[tuple[str, int]], seed: int, cleanup: bool, sampling: dict[str, Any],
           hold: ControlSignal | None = None) -> tuple[Motion, int, int]:
    """(motion, frames that were not made anew, frames that are those of the motion before) of (prompt, frames) rows.

    As `CmdmModel.multi_prompt` makes it. hold (1, T): the signal that guides it from its beginning;
    motions that are led by something else have nothing in common with it.
    """
    hold = None if hold is None or hold.is_empty else hold
    key = model.id, seed, cleanup, tuple(sorted(sampling.items())), None if hold is None else _digest(hold)
    with self._lock:
      take = self._takes.pop(key, None) or _Take()
    with progress.part("making the motion"):
      made, reused = _make(model, take, segments, seed, cleanup, sampling, hold)
    old = take.joints
    same = min(len(old), len(made.joints))
    differ = np.flatnonzero((old[:same] != made.joints[:same]).any((1, 2))) if same else []
    take.joints = made.joints
    with self._lock:
      self._takes[key] = take
      held = lambda: sum(len(other.copies) for other in self._takes.values())
      while len(self._takes) > self._max_motions or len(self._takes) > 1 and held() > self._max_copies:
        self._takes.popitem(last=False)
    return made, reused, int(differ[0]) if len(differ) else same


def _digest(signal):
  """Some bytes that signals share only where they are the same."""
  return hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in jax.tree.leaves(signal))).digest()


def _make(model, take, segments, seed, cleanup, sampling, hold):
  per_block = model.stream(segments[0][0], seed=seed, cleanup=cleanup, literal=True, **sampling).block_frames
  blocks, total = borders([frames for _, frames in segments], per_block)
  words = [prompt for (prompt, _), count in zip(segments, blocks) for _ in range(count)]
  same = next((i for i, (old, new) in enumerate(zip(take.words, words)) if old != new),
              min(len(take.words), len(words)))
  usable = [step for step in take.copies if step <= same and step < len(words)]
  take.copies = {step: take.copies[step] for step in usable}
  start = max(usable, default=None)
  if start is None:
    live = model.stream(words[0], seed=seed, num_frames=total, cleanup=cleanup, literal=True, **sampling)
    reused, pieces = 0, []
    if hold is not None:
      live.hold(hold)
  else:
    copy, reused = take.copies[start]
    live, pieces = copy.fork(total), [take.joints[:reused]]
  take.words, given, step = words, reused, start or 0
  while given < total:
    starts = step < len(words) and (not step or words[step] != words[step - 1])
    if 0 < step <= len(words) and step not in take.copies and (starts or not step % _EVERY or step == len(words)):
      take.copies[step] = live.fork(), given
    if starts and step:
      live.say(words[step])
    joints = live.step()
    given += len(joints)
    pieces.append(joints)
    step += 1
    progress.count(given, total, "frame")
  joints = np.concatenate([piece for piece in pieces if len(piece)])
  ends = np.minimum(np.cumsum(blocks) * per_block, total).tolist()
  prompts = [prompt for prompt, _ in segments]
  about = model.sampling(**sampling).about() | dict(model=model.id, way="stream")
  motion = Motion(joints, model.fps, captions_in_a_row(prompts, ends, model.fps), id="story", source=model.id,
                  license=model.license, skeleton=model.stats.layout.skeleton,
                  meta=dict(prompt=" | ".join(prompts), seed=seed, cleanup=bool(cleanup)) | about)
  return motion, reused
