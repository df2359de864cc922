"""Models that make motion block after block: whole motions, several prompts, continued motions, and streams.

A method says how a block is made, `begin_blocks` and `make_block`; all else is derived from these two, and a stream is
the motion of `generate`, block by block. A method whose blocks overlap implements `run_segments`, `continue_motion` and
`make_stream` instead.
"""
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from motion_jax.models import arguments
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.keys import keys_of, select_keys
from motion_jax.models.shared.batches import joined
from motion_jax.models.shared.script import borders, segment_ends
from motion_jax.shapes import Array, Float
from motion_jax.utils.errors import InputError

if TYPE_CHECKING:
  from motion_jax.control.signal import ControlSignal
  from motion_jax.data.clip import Clip
  from motion_jax.models.results import Motion, Motions
  from motion_jax.models.shared.streams import PromptedStream
  from motion_jax.motion.step_records import Record

Segments = Sequence[tuple[str, float | None]]  # prompts and their seconds
Frames = Sequence[tuple[str, int]]  # prompts and their frames


class BlockState(NamedTuple):
  """The state of motions between two blocks: keys (B,), the number of blocks so far, and the method's memory."""
  keys: jax.Array
  blocks: int
  memory: Any


class Sampled(NamedTuple):
  """Motions of segments: normalized features (B, T, F), frames of each, at which of them its segments end, and a record
  of the sampling."""
  features: Float[Array, "b t f"]
  frames: Sequence[int]
  ends: Sequence[Sequence[int]]
  record: dict[str, Any]


class Continued(NamedTuple):
  """A motion's end and its continuation: joints (P + N, J, 3), the new frames at which segments end, records of the
  sampling and of the cleanup."""
  joints: Float[np.ndarray, "t j 3"]
  ends: Sequence[int]
  record: dict[str, Any]
  steps: Sequence["Record"] = ()


class BlockModel(TextToMotionModel):
  """A model whose motion is made block after block. A method implements `begin_blocks` and `make_block`."""
  abilities: tuple[str, ...] = ("generate", "sample_segments", "stream", "multi_prompt", "extend")
  block_frames: int = 1

  # --- of a method -------------------------------------------------------------------------------------------------

  def begin_blocks(self, keys: jax.Array, past: Float[np.ndarray, "b t f"] | None = None) -> BlockState:
    """The state before the first block; past: normalized features that it continues."""
    raise NotImplementedError(f"{type(self).__name__} has no `begin_blocks`")

  def make_block(self, state: BlockState, prompts: Sequence[str], chosen: Any
                 ) -> tuple[Float[np.ndarray, "b n f"], BlockState]:
    """(normalized features of the next block of each motion, the state after it)."""
    raise NotImplementedError(f"{type(self).__name__} has no `make_block`")

  def constrained(self, state: BlockState, signal: "ControlSignal | None") -> BlockState:
    """The state with constraints from now on, in frames and metres from the motion's beginning; None: without. A method
    that follows constraints overrides it."""
    if signal is not None and not signal.is_empty:
      raise InputError(f"got constraints for a motion of {self.id}, which follows prompts alone; take a model that is "
                       "guided by constraints, such as cmdm-small")
    return state

  def cut(self, features: Float[np.ndarray, "b t f"], frames: Sequence[int], state: BlockState, chosen: Any
          ) -> list[int]:
    """The frames of each motion of one prompt, for a method whose motions may end by themselves; else as they are."""
    return list(frames)

  def run_segments(self, lists: Sequence[Frames], keys: jax.Array, sampling: dict[str, Any],
                   signal: "ControlSignal | None" = None, way: str = "stream") -> Sampled:
    """A motion of each list of (prompt, frames), a key each. Motions of one prompt are sampled in one batch, motions of
    several one by one; signal (B, T) constrains motions of one prompt."""
    chosen, single = self.sampling(**sampling), all(len(segments) == 1 for segments in lists)
    parts, frames, ends = [], [], []
    for rows in [list(range(len(lists)))] if single else [[row] for row in range(len(lists))]:
      state = self.constrained(self.begin_blocks(select_keys(keys, rows)), signal)
      features, state = self._run(state, [lists[row] for row in rows], chosen)
      counts = [[count for _, count in lists[row]] for row in rows]
      totals = [borders(row, self.block_frames)[1] for row in counts]
      totals = self.cut(features, totals, state, chosen) if single else totals
      parts.append(features)
      frames += totals
      ends += [[total] for total in totals] if single else [segment_ends(row, self.block_frames) for row in counts]
    return Sampled(joined(parts, len(lists)), frames, ends, self.record_of(chosen))

  def continue_motion(self, clip: "Clip", joints: Float[np.ndarray, "t j 3"], segments: Frames, keys: jax.Array,
                      cleanup: bool, sampling: dict[str, Any]) -> Continued:
    """The continuation of joints (T, J, 3): a clip's, at the model's rate and on the model's bones. cleanup: for a
    method that cleans up the new frames before they are put on the clip's own body."""
    from motion_jax.models.results import features_of
    from motion_jax.motion.representations import to_joints
    chosen, counts, past = self.sampling(**sampling), [count for _, count in segments], features_of(self, joints)
    rows, _ = self._run(self.begin_blocks(keys, self.stats.normalize(past)[None]), [segments], chosen)
    ends = segment_ends(counts, self.block_frames)
    features = np.concatenate([past, self.stats.denormalize(rows[:, :ends[-1]])[0]])
    return Continued(np.asarray(to_joints(features, self.stats.layout)), ends, self.record_of(chosen))

  def make_stream(self, segments: Sequence[tuple[str, int | None]], keys: jax.Array, num_frames: int | None,
                  cleanup: bool, sampling: dict[str, Any]) -> "PromptedStream":
    """A stream of segments [(prompt, frames)], the last without end."""
    from motion_jax.models.shared.streams import BlockStream
    return BlockStream(self, self.sampling(**sampling), keys, segments, num_frames, cleanup)

  def _run(self, state, lists, chosen):
    """(normalized features (B, T, F) in whole blocks, the state after them) of lists of segments."""
    prompts = [[prompt for (prompt, _), count in zip(segments, borders([frames for _, frames in segments],
                                                                       self.block_frames)[0])
                for _ in range(count)] for segments in lists]
    blocks = []
    for block in range(max(map(len, prompts))):
      features, state = self.make_block(state, [row[min(block, len(row) - 1)] for row in prompts], chosen)
      blocks.append(features)
    return np.concatenate(blocks, axis=1), state

  # --- whole motions -----------------------------------------------------------------------------------------------

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: "ControlSignal | None" = None) -> "Motions":
    """One pass: motions of prompts, a key each; signal (B, longest): their constraints."""
    lists = [[segment] for segment in zip(prompts, frames)]
    return self._motions(lists, self.run_segments(lists, keys, sampling, signal), seeds, cleanup)

  def sample_segments(self, lists: Sequence[Frames], keys: jax.Array, seeds: Sequence[int | None], cleanup: bool,
                      sampling: dict[str, Any], way: str = "stream", ease: bool | None = None) -> "Motions":
    """A motion of each list of (prompt, frames), a key each; see `multi_prompts`. ease None: as cleanup."""
    self._check_way(way)
    ease = cleanup if ease is None else ease
    sampled = self.run_segments(lists, keys, sampling, way=way)
    record = sampled.record | ({"way": way} if self.ways else {}) | ({"eased": True} if ease else {})
    return self._motions(lists, sampled._replace(record=record), seeds, cleanup, ease)

  def _motions(self, lists, sampled, seeds, cleanup, ease=False):
    from motion_jax.models.results import captions_in_a_row, make_motions
    captions = [captions_in_a_row([prompt for prompt, _ in segments], ends, self.fps)
                for segments, ends in zip(lists, sampled.ends)]
    return make_motions(self, sampled.features, sampled.frames, captions, seeds, sampled.record, cleanup, ease)

  def _check_way(self, way):
    if way not in (ways := self.ways or ("stream",)):
      raise InputError(f"got way {way!r}, expected one of {', '.join(ways)}")

  @arguments.checked
  def multi_prompt(self, segments: Segments, *, rng: jax.Array | None = None, seed: int | None = None,
                   seeds: Iterable[int] | None = None, way: str = "stream", cleanup: bool = False, ease: bool = False,
                   **sampling: Any) -> "Motion":
    """One motion of several prompts in sequence: [("a person walks", 4.0), ("he sits down", None), ...], in seconds.

    None is the model's default length. See `multi_prompts`; sampling: choices of this method's `options`.
    """
    return self.multi_prompts([segments], rng=rng, seeds=seeds, seed=seed, way=way, cleanup=cleanup, ease=ease,
                              **sampling)[0]

  @arguments.checked
  def multi_prompts(self, lists: Iterable[Segments], *, rng: jax.Array | None = None,
                    seeds: Iterable[int] | None = None, seed: int | None = None, way: str = "stream",
                    cleanup: bool = False, ease: bool = False, **sampling: Any) -> "Motions":
    """A motion as of `multi_prompt` for each of several lists of segments; each is independent of the others. The
    captions of a motion say when each prompt plays.

    way: "stream" changes the prompt between the blocks of one run: lengths are rounded to whole blocks, and the end is
    cut to the requested sum. "chain", of CMDM, is the released code's: one run per prompt, conditioned on the last
    latent of the one before, lengths floored to whole latents (4 frames). ease: sudden changes of speed where prompts
    change are spread over 0.4 s (`motion.blending.eased`); features stay as sampled.
    """
    rows = [self.segments_of(segments) for segments in lists]
    if not rows:
      raise InputError("got no prompts, expected a list of (prompt, seconds or None) for each motion")
    keys, seeds = keys_of(rng, seeds, len(rows), seed)
    return self.sample_segments(rows, keys, seeds, cleanup, sampling, way, ease)

  def segments_of(self, segments: Segments) -> list[tuple[str, int]]:
    """[(prompt, frames)] of the [(prompt, seconds or None)] of one motion, checked."""
    if isinstance(segments, str) or not len(segments) or any(
        isinstance(segment, str) or len(segment) != 2 for segment in segments):
      raise InputError(f"got the prompts {segments!r}, expected a list of (prompt, seconds or None)")
    prompts = self.prompts_of([prompt for prompt, _ in segments])
    rows = [(prompt, self.frames_of([prompt], None, seconds)[0]) for prompt, (_, seconds) in zip(prompts, segments)]
    if (total := sum(count for _, count in rows)) > self.max_seconds * self.fps:
      raise InputError(f"got prompts for {total / self.fps:.0f} s, expected at most {self.max_seconds:.0f}; a stream "
                       "has no end")
    return rows

  def segment_frames(self, frames: Sequence[int], way: str = "stream") -> list[int]:
    """The frames that each segment of `multi_prompt` gets where `frames` were requested."""
    return np.diff([0, *segment_ends(frames, self.block_frames)]).tolist()

  # --- continued motions and streams -------------------------------------------------------------------------------

  @arguments.checked
  def extend(self, clip: "Clip | Array", prompt: str | Segments, num_frames: int | None = None, *,
             seconds: float | None = None, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, cleanup: bool = False, **sampling: Any) -> "Motion":
    """Continues an existing motion: a Clip of any source (`motion_jax.export.load` reads files), joints (T, J, 3), or
    features (T, F) as this model knows them, not normalized.

    prompt: a sentence, or segments as for `multi_prompt`. The clip's own frames come back unchanged, resampled if its
    rate is another; the new ones begin where it ends, on the clip's own bones.
    """
    return self._extended(clip, prompt, num_frames, seconds, keys_of(rng, seeds, 1, seed), cleanup, sampling)

  def _extended(self, clip, prompt, num_frames, seconds, random, cleanup, sampling, **choices):
    """random: (keys, seeds); choices: further arguments of the method's `continue_motion`."""
    from motion_jax.models.results import captions_in_a_row, extended_motion
    from motion_jax.models.shared.known_motion import KnownMotion, at_rate, clip_of
    from motion_jax.motion import step_records
    if isinstance(prompt, str):
      if num_frames is not None or seconds is not None:
        seconds = self.frames_of([prompt], num_frames, seconds)[0] / self.fps
      prompt = [(prompt, seconds)]
    segments, (keys, seeds), layout = self.segments_of(prompt), random, self.stats.layout
    clip = clip_of(clip, layout)
    known = KnownMotion.of(at_rate(clip, self.fps, layout.skeleton), layout.skeleton)
    joints, ends, record, steps = self.continue_motion(clip, known.on_model, segments, keys, cleanup, sampling,
                                                      **choices)
    prompts = [text for text, _ in segments]
    record |= dict(prompt=" | ".join(prompts), seed=seeds[0], cleanup=bool(cleanup))
    new = known.continued(joints, ends[-1], self.fps, cleanup)
    if cleanup and not steps:
      before = known.continued(joints, ends[-1], self.fps, False)
      steps = [step_records.record("cleanup", "bone lengths restored, feet pinned", before, new, layout.skeleton,
                      start=len(known.joints))]
    return extended_motion(self, clip, known.joints, new, captions_in_a_row(prompts, ends, self.fps), record, *steps)

  @arguments.checked
  def stream(self, prompt: str | Segments, *, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, num_frames: int | None = None, cleanup: bool = False,
             **sampling: Any) -> "PromptedStream":
    """Yields joints (n, J, 3) block after block, without end unless num_frames says so; memory stays flat.

    prompt: a sentence, or segments as for `multi_prompt`, the last of which has no end. `say` changes the prompt while
    it runs. The same key gives the same motion as `generate` and `multi_prompt`.
    """
    keys, _ = keys_of(rng, seeds, 1, seed)
    segments = [(text, None) for text in self.prompts_of(prompt)] if isinstance(prompt, str) else (
        self.segments_of(prompt))
    if num_frames is not None:
      self.frames_of([segments[0][0]], num_frames, None)
    return self.make_stream(segments, keys, num_frames, cleanup, sampling)
