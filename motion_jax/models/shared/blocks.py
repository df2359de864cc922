"""Models that make motion block after block, each from those before it: whole motions, several prompts, and streams.

A method says how a block is made, `begin_blocks` and `make_block`; everything else drives these two, so a stream is the
motion that `generate` gives, block by block.
"""
import copy
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Clip
from motion_jax.models import arguments
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.keys import keys_of
from motion_jax.models.results import Motion, Motions, captions_in_a_row, features_of, gathered, go_on, make_motions
from motion_jax.models.shared.known_motion import KnownMotion, at_rate, clip_of
from motion_jax.models.shared.moving_path import Path, continue_path
from motion_jax.models.shared.streams import PromptedStream
from motion_jax.motion.cleanup import Cleaner
from motion_jax.motion.representations import to_joints
from motion_jax.shapes import Array
from motion_jax.utils.errors import InputError

Segments = Sequence[tuple[str, float | None]]  # prompts and their seconds


class BlockState(NamedTuple):
  """Where a motion stands between two blocks: keys (B,), how many blocks there are, and what the method remembers."""
  keys: jax.Array
  blocks: int
  memory: Any


def prompts_by_block(segments: Sequence[tuple[str, int]], block_frames: int) -> list[str]:
  """The prompt of each block of segments [(prompt, frames)]: borders are rounded to whole blocks, at least one each."""
  found: list[str] = []
  total = 0
  for i, (prompt, frames) in enumerate(segments):
    total += frames
    end = -(-total // block_frames) if i == len(segments) - 1 else round(total / block_frames)
    found += [prompt] * max(end - len(found), 1)
  return found


class BlockModel(TextToMotionModel):
  """A model whose motion is made block after block. A method implements `begin_blocks` and `make_block`."""
  abilities: tuple[str, ...] = ("generate", "sample_segments", "stream", "multi_prompt", "extend")
  block_frames: int = 1

  def begin_blocks(self, keys: jax.Array, past: Float[np.ndarray, "b t f"] | None = None) -> BlockState:
    """The state before the first block; past: normalized features that it continues."""
    raise NotImplementedError(f"{type(self).__name__} has no `begin_blocks`")

  def make_block(self, state: BlockState, prompts: Sequence[str], chosen: Any
                 ) -> tuple[Float[np.ndarray, "b n f"], BlockState]:
    """(normalized features of the next block of each motion, the state behind it)."""
    raise NotImplementedError(f"{type(self).__name__} has no `make_block`")

  def constrained(self, state: BlockState, signal: ControlSignal | None) -> BlockState:
    """The state with constraints from now on, in frames and metres from the motion's beginning; None: without. A method
    that follows constraints overrides it."""
    if signal is not None and not signal.is_empty:
      raise InputError(f"got constraints for a motion of {self.id}, which follows prompts alone; take a model that is "
                       "guided by constraints, such as cmdm-small")
    return state

  def cut(self, made: Float[np.ndarray, "b t f"], frames: Sequence[int], state: BlockState, chosen: Any) -> list[int]:
    """The frames of each motion that count, of a method whose motions may end by themselves; else as they are."""
    return list(frames)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """One pass: motions of prompts, a key each."""
    chosen, state, pieces = self.sampling(**sampling), self.constrained(self.begin_blocks(keys), signal), []
    for _ in range(-(-max(frames) // self.block_frames)):
      made, state = self.make_block(state, prompts, chosen)
      pieces.append(made)
    made = np.concatenate(pieces, axis=1)
    frames = self.cut(made, frames, state, chosen)
    captions = [captions_in_a_row([prompt], [count], self.fps) for prompt, count in zip(prompts, frames)]
    return make_motions(self, made, frames, captions, seeds, self._about(chosen), cleanup)

  def _about(self, chosen):
    return chosen.about() | dict(model=self.id)

  def sample_segments(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
                      cleanup: bool, sampling: dict[str, Any], ease: bool = False) -> Motions:
    """A motion of each list of (prompt, frames), a key each; prompts change between blocks."""
    return gathered([self._of_segments(segments, keys[i:i + 1], seeds[i], cleanup, sampling, ease)
                     for i, segments in enumerate(lists)])

  def _of_segments(self, segments, key, seed, cleanup, sampling, ease):
    """The motion of one list."""
    chosen, total = self.sampling(**sampling), sum(count for _, count in segments)
    made = self._run(self.begin_blocks(key), segments, chosen)
    prompts, ends = [prompt for prompt, _ in segments], self._ends(segments)
    about = self._about(chosen) | ({"eased": True} if ease else {})
    captions = [captions_in_a_row(prompts, ends, self.fps)]
    return make_motions(self, made, [total], captions, [seed], about, cleanup, ease)[0]

  def _run(self, state, segments, chosen):
    """Normalized features (1, T, F) of segments, in whole blocks."""
    pieces = []
    for prompt in prompts_by_block(segments, self.block_frames):
      made, state = self.make_block(state, [prompt], chosen)
      pieces.append(made)
    return np.concatenate(pieces, axis=1)

  def _ends(self, segments):
    """The frames at which segments end, rounded as `prompts_by_block` does; the last one as given."""
    blocks, total, ends = prompts_by_block(segments, self.block_frames), sum(count for _, count in segments), []
    place = 0
    for i in range(len(segments)):
      place = max(place + 1, round(sum(count for _, count in segments[:i + 1]) / self.block_frames))
      ends.append(min(place, len(blocks)) * self.block_frames)
    return [*(min(end, total) for end in ends[:-1]), total]

  @arguments.checked
  def multi_prompt(self, segments: Segments, *, rng: jax.Array | None = None, seed: int | None = None,
                   seeds: Iterable[int] | None = None, cleanup: bool = False, ease: bool = False, **sampling: Any
                   ) -> Motion:
    """One motion of several prompts in sequence: [("a person walks", 4.0), ("he sits down", None), ...], in seconds.

    None is the model's default length. Prompts change between blocks; the end is cut to the requested sum. ease: sudden
    changes of speed where prompts change are spread over 0.4 s (`motion.blending.eased`); features stay as sampled.
    """
    return self.multi_prompts([segments], rng=rng, seeds=seeds, seed=seed, cleanup=cleanup, ease=ease, **sampling)[0]

  @arguments.checked
  def multi_prompts(self, lists: Iterable[Segments], *, rng: jax.Array | None = None,
                    seeds: Iterable[int] | None = None, seed: int | None = None, cleanup: bool = False,
                    ease: bool = False, **sampling: Any) -> Motions:
    """A motion as of `multi_prompt` for each of several lists of segments; each is independent of the others."""
    rows = [self.segments_of(one) for one in lists]
    if not rows:
      raise InputError("got no prompts, expected a list of (prompt, seconds or None) for each motion")
    keys, seeds = keys_of(rng, seeds, len(rows), seed)
    return self.sample_segments(rows, keys, seeds, cleanup, sampling, ease)

  def segments_of(self, segments: Segments) -> list[tuple[str, int]]:
    """[(prompt, frames)] of the [(prompt, seconds or None)] of one motion, checked."""
    if isinstance(segments, str) or not len(segments) or any(isinstance(one, str) or len(one) != 2 for one in segments):
      raise InputError(f"got the prompts {segments!r}, expected a list of (prompt, seconds or None)")
    prompts = self.prompts_of([prompt for prompt, _ in segments])
    return [(prompt, self.frames_of([prompt], None, seconds)[0]) for prompt, (_, seconds) in zip(prompts, segments)]

  def segment_frames(self, frames: Sequence[int]) -> list[int]:
    """The frames that each segment of `multi_prompt` gets where `frames` were requested."""
    return np.diff([0, *self._ends([("", count) for count in frames])]).tolist()

  @arguments.checked
  def extend(self, clip: Clip | Array, prompt: str | Segments, num_frames: int | None = None, *,
             seconds: float | None = None, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, cleanup: bool = False, **sampling: Any) -> Motion:
    """Continues an existing motion: a Clip of any source, joints (T, J, 3), or features (T, F), not normalized.

    prompt: a sentence, or segments as for `multi_prompt`. The clip's own frames come back unchanged, resampled if its
    rate is another; the new ones begin where it ends, on the clip's own bones.
    """
    if isinstance(prompt, str):
      if num_frames is not None or seconds is not None:
        seconds = self.frames_of([prompt], num_frames, seconds)[0] / self.fps
      prompt = [(prompt, seconds)]
    rows, clip, layout = self.segments_of(prompt), clip_of(clip, self.stats.layout), self.stats.layout
    keys, seeds = keys_of(rng, seeds, 1, seed)
    known = KnownMotion.of(at_rate(clip, self.fps, layout.skeleton), layout.skeleton)
    past = features_of(self, known.on_model)
    chosen, total = self.sampling(**sampling), sum(count for _, count in rows)
    made = self._run(self.begin_blocks(keys, self.stats.normalize(past)[None]), rows, chosen)[:, :total]
    whole = np.concatenate([past, self.stats.denormalize(made)[0]])
    prompts, ends = [text for text, _ in rows], self._ends(rows)
    about = self._about(chosen) | dict(prompt=" | ".join(prompts), seed=seeds[0], cleanup=bool(cleanup))
    new = known.continued(np.asarray(to_joints(whole, layout)), total, self.fps, cleanup)
    return go_on(self, clip, known.joints, new, captions_in_a_row(prompts, ends, self.fps), about)

  @arguments.checked
  def stream(self, prompt: str | Segments, *, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, num_frames: int | None = None, cleanup: bool = False,
             **sampling: Any) -> "BlockStream":
    """Yields joints (n, J, 3) block after block, without end unless num_frames says so.

    prompt: a sentence, or segments as for `multi_prompt`, the last of which has no end. The same key gives the same
    motion as `generate` and `multi_prompt`.
    """
    keys, _ = keys_of(rng, seeds, 1, seed)
    rows = [(one, None) for one in self.prompts_of(prompt)] if isinstance(prompt, str) else self.segments_of(prompt)
    if num_frames is not None:
      self.frames_of([rows[0][0]], num_frames, None)
    return BlockStream(self, self.sampling(**sampling), keys, rows, num_frames, cleanup)


class BlockStream(PromptedStream):
  """Yields joints (n, J, 3) block after block; `say` changes the prompt. Made by `BlockModel.stream`."""

  def __init__(self, model: BlockModel, chosen: Any, keys: jax.Array, segments: Sequence[tuple[str, int | None]],
               num_frames: int | None = None, cleanup: bool = False) -> None:
    """segments: [(prompt, frames)] in sequence, the last without end."""
    self._model, self._chosen, self.num_frames = model, chosen, num_frames
    self._path: Path | None = None
    self._state, self._frames, self._steps, self._given = model.begin_blocks(keys), 0, 0, 0
    layout = model.stats.layout
    self._cleaner = (Cleaner(layout.skeleton, model.fps, smoothing=model.smoothing)
                     if cleanup and layout.has_fixed_bones else None)
    self._script = self._scheduled(segments, 0)

  def __repr__(self) -> str:
    return (f"BlockStream({self._prompt()!r}: {self._frames} frames so far, {self.block_seconds:g} s a block, "
            f"{self._model.folder.name})")

  @property
  def block_frames(self) -> int:
    return self._model.block_frames

  @property
  def delay(self) -> float:
    """Seconds until a prompt that is said now begins to count: none, for a block is finished before the next begins."""
    return 0.0

  @property
  def begun(self) -> int:
    """Frames of the blocks that have begun."""
    return self._steps * self.block_frames

  @property
  def decided(self) -> int:
    """Frames that never move any more, given out or waiting for their cleanup."""
    return self._frames

  @property
  def place(self) -> tuple[float, float]:
    """x and z, metres from where the stream began, of the body in the last frame that is decided."""
    return (0.0, 0.0) if self._path is None else (float(self._path.place[0]), float(self._path.place[2]))

  @property
  def script(self) -> list[tuple[int, str]]:
    """[(first frame, prompt)] of the prompts that count now and later."""
    now = max((i for i, (first, _) in enumerate(self._script) if first <= self._steps), default=0)
    return [(first * self.block_frames, prompt) for first, prompt in self._script[now:]]

  def _scheduled(self, segments, first):
    """[(block, prompt)] of segments that begin with a block."""
    found = []
    for prompt, frames in segments:
      found.append((first, prompt))
      first += max(round((frames or 1) / self.block_frames), 1)
    return found

  def _prompt(self):
    return [prompt for first, prompt in self._script if first <= self._steps][-1]

  def say(self, prompt: str | Sequence[tuple[str, int | None]], after: float | None = None, not_before: int = 0) -> int:
    """Changes the prompt from the next block on: the frame from which it counts, from the beginning of the stream.

    after: seconds from now instead; not_before: a frame before which it does not count in any case. prompt: also
    segments [(prompt, frames or None)], in sequence, the last without end.
    """
    segments = [(prompt, None)] if isinstance(prompt, str) else prompt
    self._model.prompts_of([one for one, _ in segments])
    if after is not None and (not np.isfinite(after) or after < 0):
      raise InputError(f"got words that count after {after} s, expected 0 or more seconds from now")
    first = self._steps + int(np.ceil((after or 0.0) / self.block_seconds - 1e-9))
    first = max(first, -(-not_before // self.block_frames))
    self._script = [entry for entry in self._script if entry[0] < first] + self._scheduled(segments, first)
    return first * self.block_frames

  def hold(self, signal: ControlSignal | None, control_steps: int = 2) -> int:
    """From the next block on, these constraints in the place of those before: the first frame that is still free.

    signal (1, T): in frames and metres from the beginning of the stream; None: no constraints. control_steps has no
    effect here. Raises InputError for a method that follows prompts alone.
    """
    self._state = self._model.constrained(self._state, signal)
    return self._frames

  def fork(self, num_frames: int | None = None) -> "BlockStream":
    """A second stream that continues from here, to the same motion; the two are independent."""
    other = copy.copy(self)
    other.num_frames, other._script, other._cleaner = num_frames, list(self._script), copy.deepcopy(self._cleaner)
    return other

  def step(self) -> Float[np.ndarray, "n j 3"]:
    """The frames (n, J, 3) of one more block; cleaned ones come `motion.cleanup.LOOK_AHEAD` frames later."""
    made, self._state = self._model.make_block(self._state, [self._prompt()], self._chosen)
    self._steps += 1
    layout, features = self._model.stats.layout, self._model.stats.denormalize(made)[0]
    joints, self._path = continue_path(features, self._path, layout)
    if self.num_frames is not None:
      joints = joints[:self.num_frames - self._frames]
    self._frames += len(joints)
    if self._cleaner is not None:
      joints = self._cleaner.push(joints, layout.contacts(features[:len(joints)]))
      if self._frames == self.num_frames:
        joints = np.concatenate([joints, self._cleaner.flush()])
    self._given += len(joints)
    return joints
