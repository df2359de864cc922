"""Streams of CMDM: blocks overlap, each with the prompt of its place in the script."""
import copy
from typing import Self

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm import offline, streaming
from motion_jax.models.cmdm.loop import SamplingLoop
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.offline import CAPTIONS
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.shared.moving_path import heading_of
from motion_jax.models.shared.streams import PromptedStream, Segments
from motion_jax.shapes import Bool, Float, Int
from motion_jax.text.contrast import Contrast
from motion_jax.utils.errors import InputError


class LiveStream(PromptedStream):
  """Yields joints (n, J, 3) block after block; `say` changes the prompt. Made by `CmdmModel.stream`.

    stream = model.stream("a person walks", seed=1)
    for joints in stream:
      if time_to_rest:
        stream.say("a person sits down")

  Memory and time per block do not grow. Every block keeps the prompt with which it began, unless `say` changes it by
  `after`, so a stream of changing prompts is `CmdmModel.multi_prompt`, block by block. Cleaned frames come
  `motion.cleanup.LOOK_AHEAD` frames later than they are made: the first block is shorter by these, and a stream that
  ends (num_frames) returns them last.
  """

  def __init__(self, model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, keys: jax.Array,
               segments: Segments, num_frames: int | None = None, cleanup: bool = False,
               contrast: Contrast | None = None) -> None:
    """segments: [(prompt, frames)] in sequence, the last without end."""
    super().__init__(model, segments, plan.block * model.vae.frames_per_latent, num_frames, cleanup)
    self._plan, self._contrast, self._path = plan, contrast, None
    self._loop = SamplingLoop(model, plan, np.array([sampling.guidance_scale]), keys)
    self._set_lengths()
    self._drift = np.zeros(2)  # x and z by which the cleanup, which keeps feet from sliding, has moved the body
    self._waiting = np.zeros((0, 2))  # x and z of the body, as decoded, in frames that wait for their cleanup
    self._captions = [segments[0][0]] * CAPTIONS  # that the network attends to; blocks say which of them is theirs
    self._places: dict[int, int] = {}  # {number of a prompt: its place among the captions}
    self._encode()

  def _set_lengths(self) -> None:
    self._loop.lengths = (None if self.num_frames is None else
                          offline.latents_of([self.num_frames], self._model.vae.frames_per_latent))

  @property
  def _steps(self) -> int:
    return self._loop.steps

  @property
  def _finished(self) -> int:
    return max(self._steps - self._plan.age + 1, 0)

  @property
  def _oldest(self) -> int:
    return self._loop.base

  @property
  def place(self) -> tuple[float, float]:
    """x and z of the body in the last decided frame, in metres from where the stream began."""
    x, z = np.array(super().place) + self._drift
    return float(x), float(z)

  def hold(self, signal: ControlSignal | None, control_steps: int = 2) -> int:
    """Replaces the constraints from now on: the first frame that is still free.

    signal (1, T): of frames from the beginning of the stream on, in metres from where it began; blocks that were
    returned stay as they are; None: no constraints. A network trained on constraints gets them as far ahead as it
    looks, and latents that have begun are pulled to them by control_steps conjugate gradient steps in every second
    iteration; 0: not pulled.
    """
    if signal is not None and signal.batch != 1:
      raise InputError(f"got constraints of {signal.batch} motions, a stream is one")
    start = np.array([[*self.place, 0.0 if self._path is None else heading_of(self._path)]], np.float32)
    self._loop.hold(signal, control_steps, start)
    return self._frames

  def fork(self, num_frames: int | None = None) -> Self:
    """A second stream that continues from here, to the same motion bit for bit; the two are independent.

    num_frames: frames with which it ends, from the beginning of this one; None: without end. Where that is within a
    block, its frames there see no latent after the end, as those of a motion of this length.
    """
    other = super().fork(num_frames)
    other._captions, other._places, other._loop = list(self._captions), dict(self._places), copy.copy(self._loop)
    other._set_lengths()
    return other

  def _encode(self) -> None:
    emb, mask = self._model.encode_words(self._captions, self._contrast)
    self._loop.say(emb[None], mask[None])

  def _window_captions(self) -> tuple[Int[np.ndarray, "1 w"], Int[np.ndarray, "1 w"] | None]:
    """The places (1, W) of the captions of the window's blocks, and the first block that each block sees (None:
    any)."""
    blocks = np.minimum(self._oldest + np.arange(self._plan.width), self._steps)  # later ones have not begun
    entries = [self._script.at(block) for block in blocks]
    self._places = {entry.number: self._places[entry.number] for entry in entries if entry.number in self._places}
    before = list(self._captions)
    for entry in entries:
      if entry.number not in self._places:
        used = set(self._places.values())
        if len(used) == len(self._captions):
          self._captions += [entry.prompt] * len(self._captions)
        place = next(place for place in range(len(self._captions)) if place not in used)
        self._places[entry.number], self._captions[place] = place, entry.prompt
    if self._captions != before:
      self._encode()
    memory = self._plan.memory  # nothing precedes the first prompt
    places, starts = (np.array([column]) for column in zip(*((self._places[entry.number], entry.first)
                                                             for entry in entries)))
    return places, None if memory is None else starts - memory

  def _next_block(self) -> tuple[Float[np.ndarray, "n j 3"], Float[np.ndarray, "n f"]] | None:
    block = self._loop.step(*self._window_captions(), self._drift[None])
    if block is None:
      return None
    features = self._model.stats.denormalize(self._loop.decode(block))
    joints = self._loop.follow(features)[0]
    self._path = self._loop.paths[0]
    return joints, features[0]

  def _clean(self, joints: Float[np.ndarray, "n j 3"], contacts: Bool[np.ndarray, "n c"] | None
             ) -> Float[np.ndarray, "m j 3"]:
    self._waiting = np.concatenate([self._waiting, joints[:, 0, ::2]])
    cleaned = super()._clean(joints, contacts)
    if len(cleaned):
      self._drift = cleaned[-1, 0, ::2] - self._waiting[len(cleaned) - 1]
      self._waiting = self._waiting[len(cleaned):]
    return cleaned
