"""A stream of motion whose prompt may change: the part that is the same for all methods."""
from typing import Any, Self

import numpy as np

from motion_jax.data.clip import Caption
from motion_jax.models.results import Motion
from motion_jax.utils.errors import InputError


class PromptedStream:
  """Yields joints (n, J, 3) block after block. A method sets the fields below and writes `block_frames`, `script` and
  `step`."""
  num_frames: int | None  # frames with which the stream ends; None: without end
  _model: Any
  _frames: int            # that are decided
  _given: int             # that were returned

  @property
  def block_frames(self) -> int:
    raise NotImplementedError(f"{type(self).__name__} has no `block_frames`")

  @property
  def script(self) -> list[tuple[int, str]]:
    """[(first frame, prompt)] of the prompts that count now and later."""
    raise NotImplementedError(f"{type(self).__name__} has no `script`")

  def step(self) -> np.ndarray:
    """The frames (n, J, 3) that one more block decides, possibly none."""
    raise NotImplementedError(f"{type(self).__name__} has no `step`")

  @property
  def block_seconds(self) -> float:
    return self.block_frames / self._model.fps

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
