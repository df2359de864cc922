"""Streams: motion without end, block after block from one step, with prompts that may change on the way."""
import copy
import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Caption
from motion_jax.models import cmdm
from motion_jax.models.cmdm import multi_prompt, streaming
from motion_jax.models.cmdm.guiding import Behind, Guide
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.results import Motion
from motion_jax.motion import rotations as rot
from motion_jax.motion.cleanup import Cleaner
from motion_jax.motion.representations import Representation, root_path, to_joints
from motion_jax.text.contrast import Contrast

_LENGTH = 50   # latents whose constraints are compiled together; longer ones by doubling
_CAPTIONS = 4  # different captions that a window may show before its step is compiled for twice as many


Segments = Sequence[tuple[str, int | None]]  # prompts and their frames


class LiveStream:
  """Yields joints (n, J, 3) block after block; `say` changes what the person does. Made by `CmdmModel.stream`.

    stream = model.stream("a person walks", seed=1)
    for joints in stream:
      if time_to_rest:
        stream.say("a person sits down")

  Memory and time per block do not grow. Every block keeps the words that it was begun with, so a stream of changing
  words is `CmdmModel.multi_prompt`, block by block. Cleaned frames come `motion.cleanup.LOOK_AHEAD` frames later than
  they are made: the first block is shorter by these, and a stream that ends (num_frames) returns them last.
  """

  def __init__(self, model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, keys: jax.Array,
               segments: Segments, num_frames: int | None = None, cleanup: bool = False,
               contrast: Contrast | None = None) -> None:
    """segments: [(prompt, frames)] in sequence, the last without end."""
    self._model, self._plan, self.num_frames, self._contrast = model, plan, num_frames, contrast
    constants, latents, decoder = model.compiled.stream_start(plan, model.codec, model.params, keys)
    self._sampler = streaming.Sampler(model.dit, plan, model.params, streaming.Constants(*constants), None,
                                      sampling.guidance_scale, keys)
    self._state = cmdm.MotionStream(streaming.Stream(*latents), decoder)
    self._steps, self._frames, self._given = 0, 0, 0  # frames: that are decided; given: of them, once cleaned
    self._path: _Path | None = None
    self._tokens: np.ndarray | None = None  # of what the stream is held to (1, L, N), from block _tokens_from on
    self._tokens_from = 0
    self._signal: ControlSignal | None = None
    self._drift = np.zeros(2)  # x and z by which the cleanup, that lets feet not slide, has moved the body
    self._waiting = np.zeros((0, 2))  # x and z of the body, as decoded, in frames that wait for their cleanup
    self._before: Any = None  # the decoder's memory and the path before the window's oldest block
    layout = model.stats.layout
    self._cleaner = Cleaner(layout.skeleton, model.fps) if cleanup and layout.has_fixed_bones else None
    self._script = [(0, 0)]  # (block, slot): from that block on the caption of that slot
    (prompt, *_), self._waiting_prompts = self._scheduled(segments, 0)
    self._bank = [prompt] * _CAPTIONS
    self._encode()

  def __repr__(self) -> str:
    said = self._bank[self._script[-1][1]]
    return (f"LiveStream({said!r}: {self._frames} frames so far, {self.block_seconds:g} s a block, "
            f"{self._model.folder.name})")

  @property
  def block_frames(self) -> int:
    return self._plan.block * self._model.vae.frames_per_latent

  @property
  def block_seconds(self) -> float:
    return self.block_frames / self._model.fps

  @property
  def delay(self) -> float:
    """Seconds of motion that are under way already: when words said now begin to count, unless `after` says so."""
    return (self._steps - self._blocks) * self.block_seconds

  @property
  def begun(self) -> int:
    """Frames of the blocks that have begun, given or under way: what is said now counts from this frame on."""
    return self._steps * self.block_frames

  @property
  def decided(self) -> int:
    """Frames that never move any more, given out or waiting for their cleanup; `hold` counts from this frame on."""
    return self._frames

  @property
  def place(self) -> tuple[float, float]:
    """x and z, metres from where the stream began, of the body in the last frame that is decided."""
    x, z = self._drift if self._path is None else self._path.place[::2] + self._drift
    return float(x), float(z)

  @property
  def _blocks(self) -> int:
    """Blocks that have been given."""
    return max(self._steps - self._plan.age + 1, 0)

  def say(self, prompt: str | Segments, after: float | None = None, not_before: int = 0) -> int:
    """Changes the prompt: the frame from which it counts, from the beginning of the stream.

    It counts for the blocks that have not begun, `delay` seconds from now; a larger lag makes the delay shorter.
    after: seconds from now instead. If those are fewer, blocks that are under way change their prompt in the midst of
    denoising, the less the cleaner they are already; if more, the prompt waits. not_before: a frame before which it
    does not count in any case. prompt: also segments [(prompt, frames or None)], in sequence, the last without end.
    """
    segments = [(prompt, None)] if isinstance(prompt, str) else prompt
    self._model.prompts_of([one for one, _ in segments])
    first = self._steps
    if after is not None:
      if not np.isfinite(after) or after < 0:
        raise ValueError(f"got words that count after {after} s, expected 0 or more seconds from now")
      first = self._blocks + int(np.ceil(after / self.block_seconds - 1e-9))
    first = max(first, -(-not_before // self.block_frames))
    kept = [entry for entry in self._waiting_prompts if entry[0] < first]
    (prompt, *_), later = self._scheduled(segments, first)
    self._waiting_prompts = kept + later
    if kept:  # it waits behind prompts that wait
      self._waiting_prompts.insert(len(kept), (first, prompt))
    else:
      self._begin(prompt, first)
    return first * self.block_frames

  @property
  def script(self) -> list[tuple[int, str]]:
    """[(first frame, prompt)] of the prompts that count now and later."""
    said = [(block, self._bank[slot]) for block, slot in self._script]
    return [(block * self.block_frames, prompt) for block, prompt in said + self._waiting_prompts]

  def _scheduled(self, segments: Segments, first: int) -> tuple[list[str], list[tuple[int, str]]]:
    """(prompts, [(block, prompt)] of those after the first) of segments that begin with a block."""
    blocks, _ = multi_prompt.borders([count or 1 for _, count in segments], self.block_frames)
    starts = first + np.cumsum([0, *blocks[:-1]])
    return [prompt for prompt, _ in segments], [
        (int(at), prompt) for at, (prompt, _) in zip(starts[1:], segments[1:])]

  def _begin(self, prompt: str, first: int) -> None:
    """Says a prompt from a block on, in the place of all that was said from there on."""
    self._script = [entry for entry in self._script if entry[0] < first]
    oldest = max(self._steps - self._plan.age, 0)  # prompts of older blocks do not matter any more
    while len(self._script) > 1 and self._script[1][0] <= oldest:
      del self._script[0]
    used = {slot for _, slot in self._script}
    free = next((slot for slot in range(len(self._bank)) if slot not in used), None)
    if free is None:
      free = len(self._bank)
      self._bank += [prompt] * len(self._bank)
    self._bank[free] = prompt
    self._script.append((first, free))
    self._encode()

  def hold(self, signal: ControlSignal | None, control_steps: int = 2) -> int:
    """From now on, these constraints in the place of those before: the first frame that is still free.

    signal (1, T): of frames from the beginning of the stream on, in metres from where it began; what lies in blocks
    that were given out has no effect, and no frame that was given out moves. None asks for nothing any more. A network
    trained on constraints gets them as far ahead as it looks, and latents that are under way are pulled to them by
    control_steps conjugate gradient steps in every second iteration; 0: not pulled.
    """
    if signal is not None and signal.batch != 1:
      raise ValueError(f"got constraints of {signal.batch} motions, a stream is one")
    model = self._model
    self._tokens, self._signal, guide = None, None, None
    if signal is not None and not signal.is_empty:
      if model.dit.control:
        # Of the frames that can still change; lengths doubled from ten seconds on, so that few are compiled.
        first, count = self._base * self.block_frames, _LENGTH * model.frames_per_latent
        while count < signal.frames - first:
          count *= 2
        start = np.array([[*self.place, 0.0 if self._path is None else _heading(self._path)]], np.float32)
        self._tokens_from = self._base
        self._tokens = np.asarray(model.compiled.stream_control(
            model.codec, model.params, signal.slice_frames(first, first + count), start))
      if control_steps:
        self._signal = jax.tree.map(np.asarray, signal)
        guide = Guide.of(model.codec, model.stats, self._window(self._signal), control_steps)
    self._sampler = dataclasses.replace(self._sampler, control=None, guide=guide)
    return self._frames

  @property
  def _base(self) -> int:
    """The window's oldest block."""
    return max(self._steps - self._plan.age, 0)

  def _window(self, signal: ControlSignal) -> ControlSignal:
    """The frames of a window of blocks from the oldest one on."""
    first = self._base * self.block_frames
    return signal.slice_frames(first, first + self._plan.width * self.block_frames)

  def _held(self) -> tuple[streaming.Sampler, streaming.Stream]:
    """Sampler and state of the next step, with what the window is held to."""
    sampler, latents, size, base = self._sampler, self._state.latents, self._plan.block, self._base
    if self._tokens is not None:
      first = (base - self._tokens_from) * size
      window = self._tokens[:, first:first + self._plan.width * size]
      missing = self._plan.width * size - window.shape[1]
      sampler = dataclasses.replace(sampler, control=np.pad(window, ((0, 0), (0, missing), (0, 0))), control_first=base)
    if self._signal is None or sampler.guide is None:
      return sampler, latents._replace(behind=None)
    guide = dataclasses.replace(sampler.guide, signal=_moved(self._window(self._signal), -self._drift),
                                first=base * size)
    behind = guide.begin()
    if base:
      decoder, path = self._before
      behind = Behind(decoder, *(jnp.asarray(a, jnp.float32)[None]
                                 for a in (path.row, path.place[::2], _heading(path))))
    return dataclasses.replace(sampler, guide=guide), latents._replace(behind=behind)

  def show(self, seconds: float = 10.0) -> Motion:
    """The next seconds as a Motion, which a notebook shows in its viewer; the next call continues from there."""
    if not np.isfinite(seconds) or seconds <= 0:
      raise ValueError(f"got {seconds} s to be shown, expected more than 0")
    fps, first, pieces = self._model.fps, self._given, []
    said = [(begins - first, prompt) for begins, prompt in self.script]
    while self._given - first < seconds * fps and (joints := next(self, None)) is not None:
      pieces.append(joints)
    if not pieces:
      raise ValueError("this stream has ended; make another one to be shown")
    ends = [*(start for start, _ in said[1:]), self._given - first]
    captions = [Caption(text, max(start, 0) / fps, min(end, self._given - first) / fps)
                for (start, text), end in zip(said, ends) if start < self._given - first and end > 0]
    return Motion(np.concatenate(pieces), fps, tuple(captions), id="stream", source=self._model.id,
                  license=self._model.license, skeleton=self._model.stats.layout.skeleton)

  def fork(self, num_frames: int | None = None) -> "LiveStream":
    """A second stream that continues from here, to the same motion bit for bit; the two are independent.

    num_frames: frames that it ends with, counted from the beginning of this one; None is without end.
    """
    other = copy.copy(self)
    other.num_frames, other._bank, other._script = num_frames, list(self._bank), list(self._script)
    other._waiting_prompts = list(self._waiting_prompts)
    other._cleaner = copy.deepcopy(self._cleaner)
    return other

  def _encode(self) -> None:
    emb, mask = self._model.encode_words(self._bank, self._contrast)
    text = self._model.compiled.stream_words(self._plan.guided, self._model.params, emb[None], mask[None])
    self._sampler = dataclasses.replace(self._sampler, text=text)

  def _captions(self, active: int) -> tuple[Int[jax.Array, "1 {active}"], Int[jax.Array, "1 {active}"] | None]:
    """The slots (1, active) of the window's blocks, and the first block that each of them sees (None: any)."""
    blocks = max(self._steps - self._plan.age, 0) + np.arange(active)
    starts, slots = (np.array(column) for column in zip(*self._script))
    at = np.maximum(np.searchsorted(starts, blocks, side="right") - 1, 0)
    as_row = lambda values: jnp.asarray(values[None], jnp.int32)
    memory = self._plan.memory  # the very first words have nothing before them
    return as_row(slots[at]), None if memory is None else as_row(starts[at] - memory)

  def __iter__(self) -> "LiveStream":
    return self

  def __next__(self) -> np.ndarray:
    if self.num_frames is not None and self._frames >= self.num_frames:
      raise StopIteration
    joints = self.step()
    while not len(joints):  # nothing is clean yet, or all of it waits for what comes behind it
      joints = self.step()
    return joints

  def step(self) -> np.ndarray:
    """One more block begins, and those under way come as much nearer to clean: the frames (n, J, 3) that this decides,
    at first none."""
    while self._waiting_prompts and self._waiting_prompts[0][0] <= self._steps:
      first, prompt = self._waiting_prompts.pop(0)
      self._begin(prompt, first)
    plan, layout, width = self._plan, self._model.stats.layout, -(-self._plan.width // 2)
    # Two compiled widths: the start and the rest.
    active = min(-(-min(self._steps + 1, plan.width) // width) * width, plan.width)
    sampler, latents = self._held()
    before = self._state.decoder, self._path
    self._state, made, _ = self._model.compiled.stream_step(
        active, self._steps > plan.age, self._model.codec, sampler, self._state._replace(latents=latents),
        *self._captions(active))
    self._before = before
    self._steps += 1
    if self._steps < plan.age:
      return np.zeros((0, layout.skeleton.num_joints, 3), np.float32)
    features = self._model.stats.denormalize(np.asarray(made))[0]
    joints, self._path = _continue_path(features, self._path, layout)
    if self.num_frames is not None:
      joints = joints[:self.num_frames - self._frames]
    self._frames += len(joints)
    if self._cleaner is not None:
      self._waiting = np.concatenate([self._waiting, joints[:, 0, ::2]])
      joints = self._cleaner.push(joints, layout.contacts(features[:len(joints)]))
      if len(joints):
        self._drift = joints[-1, 0, ::2] - self._waiting[len(joints) - 1]
        self._waiting = self._waiting[len(joints):]
      if self._frames == self.num_frames:
        joints = np.concatenate([joints, self._cleaner.flush()])
    self._given += len(joints)
    return joints


def _moved(signal: ControlSignal, by: np.ndarray) -> ControlSignal:
  """A signal whose places over the ground are moved by x and z (2,)."""
  offset = np.array([by[0], 0, by[1]], np.float32)
  return dataclasses.replace(signal, positions=np.where(signal.given, signal.positions + offset, 0))


class _Path(NamedTuple):
  """Where a stream has got to: the last row of features, its heading (4,) and its place (3,)."""
  row: np.ndarray
  heading: np.ndarray
  place: np.ndarray


def _heading(path: _Path) -> float:
  return float(-2 * np.arctan2(path.heading[2], path.heading[0]))


def _continue_path(features: Float[np.ndarray, "n f"], past: _Path | None, layout: Representation
                   ) -> tuple[Float[np.ndarray, "n j 3"], _Path]:
  """Joints (n, J, 3) of the next rows of a stream (n, F), going on from where the last ones ended -> (joints, past).

  Heading and place are summed in float64: after an hour's walk they are as exact as at the start.
  """
  rows = features if past is None else np.concatenate([past.row, features])
  joints = to_joints(rows, layout).astype(np.float64)
  heading, path = root_path(rows, layout)
  if past is not None:
    # Seen from the row that old and new rows share: in some layouts a row holds the step to it.
    place, turn = path[0] * [1, 0, 1], rot.multiply(rot.conjugate(past.heading), heading[0])
    joints = rot.rotate(turn, joints - place)[1:] + past.place
    path = rot.rotate(turn, path - place) + past.place
    heading = rot.multiply(rot.multiply(heading, rot.conjugate(heading[0])), past.heading)
  return joints.astype(np.float32), _Path(rows[-1:], heading[-1], path[-1] * [1, 0, 1])
