"""One live motion per WebSocket: a thread samples blocks and applies the page's messages between two blocks."""
import collections
import functools
import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError, reason
from motion_jax_studio.server import fields, stream_constraints
from motion_jax_studio.server.library import Library, live_sampling
from motion_jax_studio.server.limits import Limits, check_sampling
from motion_jax_studio.server.poses import RATE, Poses
from motion_jax_studio.server.request_types import types_of
from motion_jax_studio.server.requests import nearest_caption
from motion_jax_studio.server.serialization import Block, pack, pack_poses

_HISTORY = 8    # frames before a block that also enter the computation of its foot contacts
_QUEUED = 200   # messages of a page that may wait while a model compiles or a block is sampled
_WITHOUT_STREAM = ("start", "stop", "ack", "speed", "keep_going")  # messages that need no stream
_log = logging.getLogger("motion_jax_studio.server")


class Stream:
  """A stream of one page: `receive` takes its messages, `send` gets the replies and blocks, from the stream's thread.

  It samples while fewer than `ahead` blocks are unacknowledged and the last block is less than `ahead` blocks in front
  of a clock that runs at `speed`, so that no blocks pile up for a page that has stopped reading. An error ends only
  this stream.
  """

  def __init__(self, library: Library, limits: Limits, send: Callable[[dict[str, Any] | bytes | None], None]) -> None:
    self._library, self._limits, self._send = library, limits, send
    self._wake = threading.Condition()
    self._inbox: collections.deque[tuple[str, Any]] = collections.deque()  # (type, message)
    self._closed = False
    self._acknowledged, self._sequence, self._runs = -1, 0, 0
    self._start: Any = None  # the choices of the next run: a `Start`
    self._live: _Run | None = None
    self._paused, self._checked_at, self._sent_state = False, time.monotonic(), ""
    self._thread = threading.Thread(target=self._work, name="stream", daemon=True)
    self._thread.start()

  # --- from the page ---------------------------------------------------------------------------------------------

  def receive(self, message: Any) -> None:
    """Queues a message of the page. Raises InputError for an invalid one, which changes nothing."""
    messages, kind = types_of(self._limits).messages, message.get("type") if isinstance(message, dict) else None
    if isinstance(message, dict) and kind is None:
      raise InputError("type is missing")
    if isinstance(message, dict) and (not isinstance(kind, str) or kind not in messages):
      raise InputError(f"got a message of type {str(kind)[:40]!r}, expected one of {', '.join(messages)}")
    body = {name: value for name, value in message.items() if name != "type"} if isinstance(message, dict) else message
    request = fields.parse(messages[kind or "stop"], body, self._limits)
    with self._wake:
      if len(self._inbox) >= _QUEUED:
        raise InputError(f"{_QUEUED} messages wait to be done already; wait a moment")
      self._inbox.append((kind, request))
      self._wake.notify()

  def close(self) -> None:
    """Ends the stream after the block that is being sampled."""
    with self._wake:
      self._closed = True
      self._wake.notify()

  def join(self, seconds: float) -> bool:
    """Wait for the thread for a number of seconds; returns whether it has ended."""
    self._thread.join(seconds)
    return not self._thread.is_alive()

  # --- messages, in the thread -------------------------------------------------------------------------------------

  def _apply(self, kind, message):
    try:
      if self._live is None and kind not in _WITHOUT_STREAM:
        raise InputError("there is no stream yet; start one with a start message")
      getattr(self, f"_on_{kind}")(message)
    except ValueError as error:  # prompts or choices that the model does not accept
      self._send({"type": "error", "fatal": False, "message": reason(error, 400)})

  def _on_start(self, start):
    """Starts a motion; if that fails, the previous motion continues."""
    slot = self._library.slot(start.model)
    pipeline = self._pipeline(slot)
    if pipeline is None:
      return
    model, seed = pipeline.model, secrets.randbelow(1 << 31) if start.seed is None else start.seed
    check_sampling(model, start.sampling)
    sampling, cleanup = live_sampling(model, start.sampling), start.cleanup and "cleanup" not in start.without
    stream = pipeline.stream(start.prompt, seed=seed, num_frames=start.frames, cleanup=cleanup, without=start.without,
                             **sampling)
    skeleton = model.stats.layout.skeleton
    poses = start.pose and Poses(start.pose, skeleton, model.fps)
    self._live, self._start = _Run(stream, pipeline, seed, poses), start
    self._runs, self._paused = self._runs + 1, False
    self._send({"type": "started", "run": self._runs, "sequence": self._sequence, "model": slot.name,
                "id": model.id, "seed": seed, "cleanup": cleanup, "fps": model.fps,
                "joints": list(skeleton.joints), "parents": [int(parent) for parent in skeleton.parents],
                "block_frames": round(stream.block_seconds * model.fps), "ahead": start.ahead,
                "sampling": model.sampling(**sampling).about()} | ({"pose": poses.about} if poses else {}))
    self._sent_state = ""
    self._announce_prompts(start.prompt, 0)

  def _on_restart(self, message):
    live = self._live
    self._on_start(self._changed(prompt=message.prompt or live.stream.prompt,
                                 seed=live.seed if message.seed is None else message.seed))

  def _on_prompt(self, message):
    self._announce_prompts(message.prompt, self._live.stream.say(message.prompt, message.after))

  def _on_control(self, message):
    first = self._live.constrain(list(message.control), message.at, self._limits)
    self._send({"type": "constrained", "run": self._runs, "from_frame": first,
                "until_frame": self._live.constrained_until})

  def _on_speed(self, message):
    self._start = self._changed(speed=message.value)

  def _on_keep_going(self, message):
    self._start = self._changed(keep_going=message.on)
    self._send_state()

  def _on_ack(self, message):
    self._acknowledged = max(self._acknowledged, min(message.sequence, self._sequence - 1))

  def _on_pause(self, message, paused=True):
    self._paused = paused
    self._send_state()

  _on_resume = functools.partialmethod(_on_pause, paused=False)

  def _on_stop(self, message):
    self._send_state("stopped")
    self._live = None

  def _changed(self, **changes):
    """The choices of this run with changes, if there is one."""
    return self._start and msgspec.structs.replace(self._start, **changes)

  # --- in the thread ---------------------------------------------------------------------------------------------

  def _work(self):
    try:
      while self._turn():
        pass
    except Exception as error:
      known = isinstance(error, ValueError)
      if not known:
        _log.exception("a stream failed")
      self._send({"type": "error", "fatal": True, "message": reason(error, 400) if known else
                  f"this stream met a fault of the program ({type(error).__name__}); other streams are not "
                  "affected; start it again"})
    finally:
      self._live = None
      self._send(None)

  def _turn(self) -> bool:
    """Apply the queued messages, then sample a block if there is room; returns False once the page is closed."""
    with self._wake:
      while not (self._closed or self._inbox or self._may_step()):
        self._wake.wait(0.02 if self._is_running() and self._has_room() else 5.0)
      if self._closed:
        return False
      messages = list(self._inbox)
      self._inbox.clear()
    for kind, message in messages:
      self._apply(kind, message)
    if self._may_step():
      self._step()
    return True

  def _is_running(self):
    """Whether the clock runs: started, not paused, and not waiting for a prompt."""
    return self._live is not None and not self._paused and not self._is_waiting()

  def _is_waiting(self):
    return not self._start.keep_going and self._live.sent >= self._live.end_of_prompt

  def _has_room(self):
    return self._sequence - 1 - self._acknowledged < self._start.ahead

  def _may_step(self):
    now = time.monotonic()
    passed, self._checked_at = now - self._checked_at, now
    if not self._is_running():
      return False
    live, speed = self._live, self._start.speed
    # The page cannot play frames that have not arrived: after waiting for the sampler, the clock does not catch up.
    live.position = min(live.position + passed * speed, live.sent / live.fps)
    lead = self._start.ahead * live.stream.block_seconds
    return self._has_room() and (not speed or live.sent / live.fps < live.position + lead)

  def _pipeline(self, slot):
    """The pipeline of a model, once it is ready; None if the page has gone by then. Sends its loading progress."""
    sent = None
    while not slot.ready.wait(0.2):
      about = slot.progress()
      if (about["state"], about["doing"], int(about["seconds"])) != sent:
        sent = about["state"], about["doing"], int(about["seconds"])
        self._send({"type": "state"} | about)
      if self._closed:
        return None
    return self._library.pipeline(slot.name, "stream")

  def _announce_prompts(self, prompt, first):
    """Sends a message for each action of a prompt that takes effect from frame `first` on."""
    live, warns = self._live, "warn" not in self._start.without
    captions = live.pipeline.model.captions
    actions = [(begins, action) for begins, action in live.stream.script if begins >= first]
    for begins, action in actions:
      action = prompt if len(actions) == 1 else action
      unknown = captions.unknown_words(action) if warns and captions.is_english(action) else []
      notes = live.pipeline.notes([action], postures=False) if warns else []
      self._send({"type": "words", "words": live.stream.prompt_number(begins), "prompt": action, "whole": prompt,
                  "from_frame": begins, "run": self._runs, "unknown": unknown[:10],
                  "nearest": nearest_caption(live.pipeline, action) if unknown or notes else "", "notes": notes})
    self._send_state()

  def _send_state(self, state=None):
    if state is None and self._live is None:
      return
    state = state or ("paused" if self._paused else "waiting" if self._is_waiting() else "running")
    if state != self._sent_state:
      self._sent_state = state
      self._send({"type": "state", "state": state, "run": self._runs, "frames": self._live.sent if self._live else 0})

  def _step(self):
    live = self._live
    if live.stream.num_frames is not None and live.sent >= live.stream.num_frames:
      self._send_state("ended")
      self._live = None
      return
    block, poses = live.step(self._sequence, self._runs, self._limits)
    if block is None:
      return
    self._send(pack(block))
    if len(poses):
      self._send(pack_poses(poses, self._sequence, self._runs, live.poses.count - len(poses), RATE))
    self._sequence += 1
    self._send_state()


class _Run:
  """A motion of a stream, from its beginning: what was sent of it, its constraints, poses and sampling time."""

  def __init__(self, stream, pipeline, seed, poses):
    self.stream, self.pipeline, self.seed, self.poses = stream, pipeline, seed, poses
    self.fps, self.skeleton = pipeline.model.fps, pipeline.model.stats.layout.skeleton
    self.sent, self.position = 0, 0.0  # frames; seconds of the page's clock
    self.constrained_until = 0  # frames
    self._course, self._course_at = None, 0  # the first free frame at the last update of the course
    self._spent, self._recent = 0.0, None  # seconds since the last block; the last frames
    self._end: tuple[Any, int] = None, 0  # the last entry of the script, and the frame at which its action ends

  @property
  def end_of_prompt(self):
    """The frame at which the action of the last prompt ends, computed when it is first needed."""
    entry, planner = self.stream.script[-1], self.pipeline.planner
    if self._end[0] != entry:
      first, prompt = entry
      self._end = entry, first + planner.natural_frames(prompt, planner.plan(prompt).min_duration)
    return self._end[1]

  def constrain(self, control, at, limits):
    """Constrains the motion from now on; returns the first frame that is still free. at: second from which the times of
    the constraints count, or None for now."""
    stream_constraints.check(control)
    if control and self.skeleton is not HUMANML3D:
      raise InputError(f"got control of {self.skeleton.name}, a body of another skeleton; control knows the 22 joints "
                       f"of {HUMANML3D.name}")
    first = self._hold(control, at, self.stream.num_frames, limits)
    self._course = stream_constraints.Course.from_constraints(control, at, self.stream.place)
    self._course_at = self.stream.decided
    return first

  def _hold(self, control, at, end, limits):
    signal = stream_constraints.signal_of(control, at, self.stream.decided, self.stream.place, end, self.fps, limits)
    self.constrained_until = 0 if signal is None else signal.frames
    return self.stream.hold(signal)

  def _update_constraints(self, limits):
    """Before a step: continues a path without times from the body's place on it, and drops constraints of the past."""
    stream = self.stream
    if self._course and stream.decided != self._course_at:
      rest, self._course_at = self._course.rest(stream.place), stream.decided
      if rest is not None:
        self._hold([rest], None, None, limits)
        return
      self._course, self.constrained_until = None, stream.decided
    if self.constrained_until and stream.decided >= self.constrained_until:
      stream.hold(None)  # unconstrained steps are faster
      self.constrained_until = 0

  def step(self, sequence, run, limits):
    """(the next `Block`, rows of poses) with these numbers; (None, ()) if no frame is final yet."""
    began = time.perf_counter()
    self._update_constraints(limits)
    joints = self.stream.step()
    self._spent += time.perf_counter() - began
    if not len(joints):
      return None, ()
    near = joints if self._recent is None else np.concatenate([self._recent, joints])
    stands = feet_stand(near, self.fps, self.skeleton, floor=0.0)[-len(joints):]
    block = Block(sequence, run, self.sent, self.stream.prompt_number(self.sent), self.stream.begun, 1000 * self._spent,
                  self.fps, joints, stands)
    self.sent, self._spent, self._recent = self.sent + len(joints), 0.0, near[-_HISTORY:]
    return block, self.poses.push(joints, self.sent == self.stream.num_frames) if self.poses else ()
