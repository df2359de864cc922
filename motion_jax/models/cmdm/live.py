"""Streams: motion without end, block after block from one step, with prompts that may change on the way."""
import copy
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Int

from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm import multi_prompt, offline, streaming
from motion_jax.models.cmdm.loop import SamplingLoop
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.offline import CAPTIONS
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.shared.moving_path import Path, heading_of
from motion_jax.models.shared.streams import PromptedStream
from motion_jax.motion.cleanup import Cleaner
from motion_jax.text.contrast import Contrast

Segments = Sequence[tuple[str, int | None]]  # prompts and their frames


class LiveStream(PromptedStream):
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
    self._model, self._plan, self.num_frames, self._contrast = model, plan, None, contrast
    self._loop = SamplingLoop(model, plan, np.array([sampling.guidance_scale]), keys)
    self._set_end(num_frames)
    self._frames, self._given = 0, 0  # frames: that are decided; given: of them, once cleaned
    self._drift = np.zeros(2)  # x and z by which the cleanup, that lets feet not slide, has moved the body
    self._waiting = np.zeros((0, 2))  # x and z of the body, as decoded, in frames that wait for their cleanup
    layout = model.stats.layout
    self._cleaner = (Cleaner(layout.skeleton, model.fps, smoothing=model.smoothing)
                     if cleanup and layout.has_fixed_bones else None)
    self._script = [(0, 0)]  # (block, slot): from that block on the caption of that slot
    (prompt, *_), self._waiting_prompts = self._scheduled(segments, 0)
    self._bank = [prompt] * CAPTIONS
    self._encode()

  def _set_end(self, num_frames: int | None) -> None:
    self.num_frames = num_frames
    self._loop.lengths = (None if num_frames is None else
                          offline.latents_of([num_frames], self._model.vae.frames_per_latent))

  def __repr__(self) -> str:
    said = self._bank[self._script[-1][1]]
    return (f"LiveStream({said!r}: {self._frames} frames so far, {self.block_seconds:g} s a block, "
            f"{self._model.folder.name})")

  @property
  def block_frames(self) -> int:
    return self._plan.block * self._model.vae.frames_per_latent

  @property
  def _steps(self) -> int:
    return self._loop.steps

  @property
  def _path(self) -> Path | None:
    """Where the body, as decoded, has got to."""
    return self._loop.paths[0]

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
    start = np.array([[*self.place, 0.0 if self._path is None else heading_of(self._path)]], np.float32)
    self._loop.hold(signal, control_steps, start)
    return self._frames

  def fork(self, num_frames: int | None = None) -> "LiveStream":
    """A second stream that continues from here, to the same motion bit for bit; the two are independent.

    num_frames: frames that it ends with, counted from the beginning of this one; None is without end. Where that is
    within a block, its frames there see no latent after the end, as those of a motion of this length.
    """
    other = copy.copy(self)
    other._bank, other._script = list(self._bank), list(self._script)
    other._waiting_prompts = list(self._waiting_prompts)
    other._loop, other._cleaner = copy.copy(self._loop), copy.deepcopy(self._cleaner)
    other._set_end(num_frames)
    return other

  def _encode(self) -> None:
    emb, mask = self._model.encode_words(self._bank, self._contrast)
    self._loop.say(emb[None], mask[None])

  def _captions(self) -> tuple[Int[np.ndarray, "1 w"], Int[np.ndarray, "1 w"] | None]:
    """The slots (1, W) of the window's blocks, and the first block that each of them sees (None: any)."""
    blocks = self._loop.base + np.arange(self._plan.width)
    starts, slots = (np.array(column) for column in zip(*self._script))
    at = np.maximum(np.searchsorted(starts, blocks, side="right") - 1, 0)
    memory = self._plan.memory  # the very first words have nothing before them
    return slots[at][None], None if memory is None else starts[at][None] - memory

  def step(self) -> np.ndarray:
    """One more block begins, and those under way come as much nearer to clean: the frames (n, J, 3) that this decides,
    at first none."""
    while self._waiting_prompts and self._waiting_prompts[0][0] <= self._steps:
      first, prompt = self._waiting_prompts.pop(0)
      self._begin(prompt, first)
    layout = self._model.stats.layout
    block = self._loop.step(*self._captions(), self._drift[None])
    if block is None:
      return np.zeros((0, layout.skeleton.num_joints, 3), np.float32)
    features = self._model.stats.denormalize(self._loop.decode(block))
    joints, features = self._loop.follow(features)[0], features[0]
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
