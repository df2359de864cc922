"""Streams of motion whose prompt may change: the part that all methods share, and the stream of a `BlockModel`."""
import copy
from collections.abc import Sequence
from typing import Any, Self

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Caption
from motion_jax.models.results import Motion
from motion_jax.models.shared.moving_path import Path, continue_path
from motion_jax.models.shared.script import Script
from motion_jax.motion.cleanup import Cleaner
from motion_jax.shapes import Bool, Float
from motion_jax.utils.errors import InputError

Segments = Sequence[tuple[str, int | None]]  # prompts and their frames


class PromptedStream:
  """Yields joints (n, J, 3) block after block; `say` changes the prompt.

  A method implements `_steps` and `_next_block`, and where blocks overlap `_finished` and `_oldest`.
  """
  num_frames: int | None  # frames with which the stream ends; None: without end
  _path: Path | None  # of the body as decoded

  def __init__(self, model: Any, segments: Segments, block_frames: int, num_frames: int | None = None,
               cleanup: bool = False) -> None:
    """segments: [(prompt, frames)] in sequence, the last without end."""
    self._model, self.block_frames, self.num_frames = model, block_frames, num_frames
    self._script = Script(segments, block_frames)
    self._frames, self._given = 0, 0  # that are decided; of these, that were returned after their cleanup
    layout = model.stats.layout
    self._cleaner = (Cleaner(layout.skeleton, model.fps, smoothing=model.smoothing)
                     if cleanup and layout.has_fixed_bones else None)

  def __repr__(self) -> str:
    return (f"{type(self).__name__}({self._script.at(self._steps).prompt!r}: {self._frames} frames so far, "
            f"{self.block_seconds:g} s a block, {self._model.folder.name})")

  # --- of a method -------------------------------------------------------------------------------------------------

  @property
  def _steps(self) -> int:
    """Blocks that have begun."""
    raise NotImplementedError(f"{type(self).__name__} has no `_steps`")

  @property
  def _finished(self) -> int:
    """Blocks whose frames are decided."""
    return self._steps

  @property
  def _oldest(self) -> int:
    """The oldest block whose prompt the next step needs."""
    return self._steps

  def _next_block(self) -> tuple[Float[np.ndarray, "n j 3"], Float[np.ndarray, "n f"]] | None:
    """(joints, features, not normalized) of the block that one more step decides; None where there is none yet."""
    raise NotImplementedError(f"{type(self).__name__} has no `_next_block`")

  def _clean(self, joints: Float[np.ndarray, "n j 3"], contacts: Bool[np.ndarray, "n c"] | None
             ) -> Float[np.ndarray, "m j 3"]:
    assert self._cleaner is not None
    return self._cleaner.push(joints, contacts)

  # --- state -------------------------------------------------------------------------------------------------------

  @property
  def block_seconds(self) -> float:
    return self.block_frames / self._model.fps

  @property
  def delay(self) -> float:
    """Seconds of motion that have begun already, after which a prompt said now takes effect by default."""
    return (self._steps - self._finished) * self.block_seconds

  @property
  def begun(self) -> int:
    """Frames of the blocks that have begun: a prompt said now takes effect from this frame on."""
    return self._steps * self.block_frames

  @property
  def decided(self) -> int:
    """Frames that no longer change, returned or waiting for their cleanup; `hold` takes effect from this frame on."""
    return self._frames

  @property
  def place(self) -> tuple[float, float]:
    """x and z of the body in the last decided frame, in metres from where the stream began."""
    return (0.0, 0.0) if self._path is None else (float(self._path.place[0]), float(self._path.place[2]))

  @property
  def script(self) -> list[tuple[int, str]]:
    """[(first frame, prompt)] of the prompts of the next returned frame and of later ones."""
    current = self._script.at(self._given // self.block_frames)
    return [(entry.first * self.block_frames, entry.prompt) for entry in self._script.entries
            if entry.first >= current.first]

  def prompt_number(self, frame: int) -> int:
    """The number of a frame's prompt, counted from 1 in the order in which prompts were said; of frames that the last
    step returned, or later ones."""
    return self._script.at(frame // self.block_frames).number

  # --- prompts and steps -------------------------------------------------------------------------------------------

  def say(self, prompt: str | Segments, after: float | None = None, not_before: int = 0) -> int:
    """Changes the prompt: the frame from which it takes effect, from the beginning of the stream.

    By default that is the first block that has not begun, `delay` seconds from now. after: seconds from now instead.
    If those are fewer, blocks that have begun change their prompt while they are denoised, with less effect the cleaner
    they are; if more, the prompt waits. not_before: a frame before which it takes no effect in any case. prompt: also
    segments [(prompt, frames or None)], in sequence, the last without end.
    """
    segments = [(prompt, None)] if isinstance(prompt, str) else prompt
    self._model.prompts_of([text for text, _ in segments])
    first = self._steps
    if after is not None:
      if not np.isfinite(after) or after < 0:
        raise InputError(f"got words that count after {after} s, expected 0 or more seconds from now")
      first = self._finished + int(np.ceil(after / self.block_seconds - 1e-9))
    first = max(first, -(-not_before // self.block_frames))
    self._script.say(segments, first)
    return first * self.block_frames

  def fork(self, num_frames: int | None = None) -> Self:
    """A second stream that continues from here, to the same motion bit for bit; the two are independent.

    num_frames: frames with which it ends, from the beginning of this one; None: without end.
    """
    other = copy.copy(self)
    other.num_frames, other._script, other._cleaner = num_frames, self._script.copy(), copy.deepcopy(self._cleaner)
    return other

  def step(self) -> Float[np.ndarray, "n j 3"]:
    """The frames (n, J, 3) that one more block decides, possibly none; cleaned ones come `motion.cleanup.LOOK_AHEAD`
    frames later."""
    self._script.forget(min(self._given // self.block_frames, self._oldest))
    layout, block = self._model.stats.layout, self._next_block()
    if block is None:
      return np.zeros((0, layout.skeleton.num_joints, 3), np.float32)
    joints, features = block
    if self.num_frames is not None:
      joints = joints[:self.num_frames - self._frames]
    self._frames += len(joints)
    if self._cleaner is not None:
      joints = self._clean(joints, layout.contacts(features[:len(joints)]))
      if self._frames == self.num_frames:
        joints = np.concatenate([joints, self._cleaner.flush()])
    self._given += len(joints)
    return joints

  def __iter__(self) -> Self:
    return self

  def __next__(self) -> np.ndarray:
    if self.num_frames is not None and self._frames >= self.num_frames:
      raise StopIteration
    joints = self.step()
    while not len(joints):  # nothing is clean yet, or all of it waits for its cleanup
      joints = self.step()
    return joints

  def show(self, seconds: float = 10.0) -> Motion:
    """The next seconds as a Motion, which a notebook shows in its viewer; the next call continues from there."""
    if not np.isfinite(seconds) or seconds <= 0:
      raise InputError(f"got {seconds} s to be shown, expected more than 0")
    fps, first, pieces = self._model.fps, self._given, []
    script = [(begins - first, prompt) for begins, prompt in self.script]
    while self._given - first < seconds * fps and (joints := next(self, None)) is not None:
      pieces.append(joints)
    if not pieces:
      raise InputError("this stream has ended; make another one to be shown")
    ends = [*(start for start, _ in script[1:]), self._given - first]
    captions = [Caption(text, max(start, 0) / fps, min(end, self._given - first) / fps)
                for (start, text), end in zip(script, ends) if start < self._given - first and end > 0]
    return Motion(np.concatenate(pieces), fps, tuple(captions), id="stream", source=self._model.id,
                  license=self._model.license, skeleton=self._model.stats.layout.skeleton)


class BlockStream(PromptedStream):
  """The stream of a `BlockModel`: a block is finished before the next one begins."""

  def __init__(self, model: Any, chosen: Any, keys: jax.Array, segments: Segments, num_frames: int | None = None,
               cleanup: bool = False) -> None:
    super().__init__(model, segments, model.block_frames, num_frames, cleanup)
    self._chosen, self._state, self._path = chosen, model.begin_blocks(keys), None

  @property
  def _steps(self) -> int:
    return self._state.blocks

  def hold(self, signal: ControlSignal | None, control_steps: int = 2) -> int:
    """Replaces the constraints from the next block on: the first frame that is still free.

    signal (1, T): in frames and metres from the beginning of the stream; None: no constraints. control_steps has no
    effect here. Raises InputError for a method that follows prompts alone.
    """
    self._state = self._model.constrained(self._state, signal)
    return self._frames

  def _next_block(self) -> tuple[Float[np.ndarray, "n j 3"], Float[np.ndarray, "n f"]]:
    prompt = self._script.at(self._steps).prompt
    rows, self._state = self._model.make_block(self._state, [prompt], self._chosen)
    features = self._model.stats.denormalize(rows)[0]
    joints, self._path = continue_path(features, self._path, self._model.stats.layout)
    return joints, features
