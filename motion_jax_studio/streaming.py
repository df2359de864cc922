"""Live streams of plans: each prompt is parsed, and its actions are sent to the stream one after the other."""
from collections.abc import Collection
from typing import Any

import numpy as np

from motion_jax_studio.planning import durations
from motion_jax_studio.planning.segments import prompts_in_sequence


class PlannedStream:
  """A `LiveStream` of the library that plans its prompts: "walks forward, then sits down" is streamed action by action,
  each for its usual time, the last without end. Created by `Pipeline.stream`; other attributes are the stream's.

  out: names of steps that are left out. hold_until_done: a new prompt waits until an action that ends by itself, such
  as a kick, has had its usual time.
  """

  def __init__(self, live: Any, pipeline: Any, prompt: str, out: Collection[str] = (), hold_until_done: bool = False
               ) -> None:
    self.live, self._pipeline, self._out, self._hold_until_done = live, pipeline, out, hold_until_done
    self.prompt = prompt  # the last one, before it was planned

  def say(self, prompt: str, after: float | None = None) -> int:
    """Change the prompt; returns the first frame of the new one. See `LiveStream.say`."""
    planner, not_before = self._pipeline.planner, 0
    prompt, = planner.model.prompts_of(prompt)
    if "warn" not in self._out:
      self._pipeline.warn([prompt], "plan" not in self._out)
    if self._hold_until_done:
      begun, last = self.live.script[-1]
      not_before = begun + durations.frames_until_done(planner, last)
    segments = prompt if "plan" in self._out else prompts_in_sequence(
        planner, planner.plan(prompt), is_endless=self.live.num_frames is None)
    first = self.live.say(segments, after, not_before)
    self.prompt = prompt
    return first

  def fork(self, num_frames: int | None = None) -> "PlannedStream":
    """A second stream that continues from here, independent of this one; see `LiveStream.fork`."""
    return PlannedStream(self.live.fork(num_frames), self._pipeline, self.prompt, self._out, self._hold_until_done)

  def __getattr__(self, name):
    if name == "live":  # not set yet, as in a copy or an unpickled object
      raise AttributeError(name)
    return getattr(self.live, name)

  def __iter__(self) -> "PlannedStream":
    return self

  def __next__(self) -> np.ndarray:
    return next(self.live)

  def __repr__(self) -> str:
    return repr(self.live)
