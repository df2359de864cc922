"""A cache of multi-prompt motions: after a change, only the blocks from there on are sampled again.

A motion is generated block by block by a stream. A copy of the stream is kept at the start of each prompt and every few
blocks in between. When prompts or lengths change, sampling continues from the last copy before the first changed block.
Attention is causal and the cache exact, so that earlier frames are equal bit for bit, except for the half second that
the cleanup looks ahead.
"""
import collections
import functools
import hashlib
import threading
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control.constraints import Constraint
from motion_jax.models.results import Motion, captions_in_a_row
from motion_jax.models.shared.script import borders
from motion_jax.motion.step_records import record
from motion_jax.utils import progress
from motion_jax_studio import constraining

_EVERY = 8    # blocks between two copies of a stream


class _Take:
  """The latest motion of one model, seed and sampling, and copies of its stream."""

  def __init__(self):
    self.prompts: list[str] = []  # the prompt of each block
    self.copies: dict[int, tuple[Any, int]] = {}  # by step: (stream before that step, frames returned so far)
    self.joints = np.zeros((0, 0, 3), np.float32)


class MultiPromptCache:
  """Generates multi-prompt motions, each prompt one action, and keeps copies of their streams."""

  def __init__(self, max_motions: int = 6, max_copies: int = 150) -> None:
    """max_motions: number of motions that keep their copies; max_copies: of all motions together, a megabyte each."""
    self._max_motions, self._max_copies = max_motions, max_copies
    self._takes: collections.OrderedDict[Any, _Take] = collections.OrderedDict()
    self._lock = threading.Lock()

  def make(self, pipeline: Any, segments: Sequence[tuple[str, int]], seed: int, cleanup: bool, sampling: dict[str, Any],
           control: Sequence[Constraint] = ()) -> tuple[Motion, int, int]:
    """(motion, frames that were reused, frames equal to the previous motion) of (prompt, frames) rows.

    Equals `CmdmModel.multi_prompt`. control: constraints that the motion meets, exactly so with cleanup; it is
    compared with no previous motion.
    """
    if not control:
      return self._sample(pipeline, segments, seed, cleanup, sampling)
    constraining.check_skeleton(pipeline.model)
    fps, (prompt, last), reused = pipeline.model.fps, segments[-1], 0
    count = sum(frames for _, frames in segments)
    target = constraining.target_of(list(control), count, fps, cleanup)
    rows = [*segments[:-1], (prompt, last + target.frames_to_sample(fps) - count)]

    def sample(signals):
      nonlocal reused
      motion, reused, _ = self._sample(pipeline, rows, seed, cleanup, sampling, signals[0])
      return [motion]

    motion, = constraining.sample_guided([target], fps, sample)
    motion = constraining.constrain(pipeline.model, motion, target, cleanup)
    ends = np.minimum(np.cumsum([frames for _, frames in segments]), motion.num_frames).tolist()
    captions = captions_in_a_row([prompt for prompt, _ in segments], ends, fps)
    return motion.replace(captions=captions), reused, 0

  def _sample(self, pipeline, segments, seed, cleanup, sampling, hold=None):
    """`make` with a signal (1, T) for constraints; motions with different signals share nothing."""
    hold = None if hold is None or hold.is_empty else hold
    key = pipeline.model.id, seed, cleanup, tuple(sorted(sampling.items())), None if hold is None else _digest(hold)
    with self._lock:
      take = self._takes.pop(key, None) or _Take()
    with progress.part("generating the motion"):
      motion, reused = _make(pipeline, take, segments, seed, cleanup, sampling, hold)
    old = take.joints
    same = min(len(old), len(motion.joints))
    differ = np.flatnonzero((old[:same] != motion.joints[:same]).any((1, 2))) if same else []
    take.joints = motion.joints
    with self._lock:
      self._takes[key] = take
      held = lambda: sum(len(other.copies) for other in self._takes.values())
      while len(self._takes) > self._max_motions or len(self._takes) > 1 and held() > self._max_copies:
        self._takes.popitem(last=False)
    return motion, reused, int(differ[0]) if len(differ) else same


def _digest(signal):
  """A hash of a signal."""
  return hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in jax.tree.leaves(signal))).digest()


def _make(pipeline, take, segments, seed, cleanup, sampling, hold):
  model, stream = pipeline.model, functools.partial(pipeline.stream, seed=seed, cleanup=cleanup, plan=False, **sampling)
  per_block = stream(segments[0][0]).block_frames
  blocks, total = borders([frames for _, frames in segments], per_block)
  of_block = [prompt for (prompt, _), count in zip(segments, blocks) for _ in range(count)]
  same = next((i for i, (old, new) in enumerate(zip(take.prompts, of_block)) if old != new),
              min(len(take.prompts), len(of_block)))
  usable = [step for step in take.copies if step <= same and step < len(of_block)]
  take.copies = {step: take.copies[step] for step in usable}
  start = max(usable, default=None)
  if start is None:
    live = stream(of_block[0], num_frames=total)
    reused, pieces = 0, []
    if hold is not None:
      live.hold(hold)
  else:
    copy, reused = take.copies[start]
    live, pieces = copy.fork(total), [take.joints[:reused]]
  take.prompts, given, step = of_block, reused, start or 0
  while given < total:
    starts = step < len(of_block) and (not step or of_block[step] != of_block[step - 1])
    is_due = starts or not step % _EVERY or step == len(of_block)
    if 0 < step <= len(of_block) and step not in take.copies and is_due:
      take.copies[step] = live.fork(), given
    if starts and step:
      live.say(of_block[step])
    joints = live.step()
    given += len(joints)
    pieces.append(joints)
    step += 1
    progress.count(given, total, "frame")
  joints = np.concatenate([piece for piece in pieces if len(piece)])
  ends = np.minimum(np.cumsum(blocks) * per_block, total).tolist()
  prompts = [prompt for prompt, _ in segments]
  about = model.sampling(**sampling).about() | dict(model=model.id, way="stream")
  steps = [record("sample", f"{len(prompts)} prompts in sequence, block by block"),
           *([record("cleanup", "feet pinned, tremor removed, block by block")] if cleanup else [])]
  motion = Motion(joints, model.fps, captions_in_a_row(prompts, ends, model.fps), id="multi_prompt", source=model.id,
                  license=model.license, skeleton=model.stats.layout.skeleton,
                  meta=dict(prompt=" | ".join(prompts), seed=seed, cleanup=bool(cleanup), steps=steps) | about)
  return motion, reused
