"""One live motion per WebSocket: a thread samples blocks and applies the page's messages between two blocks."""
import collections
import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError, reason
from motion_jax_studio.server import fields, stream_constraints
from motion_jax_studio.server.library import Library, live_sampling
from motion_jax_studio.server.limits import Limits, check_sampling
from motion_jax_studio.server.poses import RATE, Poses
from motion_jax_studio.server.request_types import DEFAULT_AHEAD, types_of
from motion_jax_studio.server.requests import nearest_caption
from motion_jax_studio.server.serialization import Block, pack, pack_poses

_HISTORY = 8    # frames before a block that also enter the computation of its foot contacts
_QUEUED = 200   # messages of a page that may wait while a model compiles or a block is sampled
_log = logging.getLogger("motion_jax_studio.server")


class _Pace(NamedTuple):
  """Playback speed of a page; whether its stream continues after the action of the last prompt; largest number of
  unacknowledged blocks."""
  speed: float = 1.0
  keep_going: bool = True
  ahead: int = DEFAULT_AHEAD


class Stream:
  """A stream of one page: `receive` takes its messages, `send` gets the replies and blocks, from the stream's thread.

  It samples while fewer than `ahead` blocks are unacknowledged and the last block is less than `ahead` blocks in front
  of a clock that runs at `speed`, so that no blocks pile up for a page that has stopped reading. An error ends only
  this stream.
  """

  def __init__(self, library: Library, limits: Limits, send: Callable[[dict[str, Any] | bytes | None], None]) -> None:
    self._library, self._limits, self._send = library, limits, send
    self._wake = threading.Condition()
    self._inbox: collections.deque[Callable[[], None]] = collections.deque()
    self._closed = False
    self._acknowledged, self._sequence, self._run = -1, 0, 0
    self._prompts, self._prompts_before = 0, 0  # numbers of the last prompt announced, and of the last of earlier runs
    self._live: Any = None
    self._choices: dict[str, Any] = {}
    self._paused, self._pace = False, _Pace()
    self._sent, self._position, self._checked_at = 0, 0.0, time.monotonic()
    self._ends: int | None = None  # see `_end_of_prompt`
    self._constrained_until = 0  # frames
    self._course: stream_constraints.Course | None = None
    self._course_at = 0  # the first free frame at the last update of the course
    self._tail, self._sent_state = None, ""
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
    action = getattr(self, f"_on_{kind}")(request)
    with self._wake:
      if len(self._inbox) >= _QUEUED:
        raise InputError(f"{_QUEUED} messages wait to be done already; wait a moment")
      self._inbox.append(action)
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

  def _on_start(self, request):
    choices = {"name": self._library.slot(request.model).name, "prompt": request.prompt,
               "seed": secrets.randbelow(1 << 31) if request.seed is None else request.seed,
               "cleanup": request.cleanup and "cleanup" not in request.without, "without": tuple(request.without),
               "sampling": request.sampling, "frames": request.frames,
               "pose": request.pose}
    return lambda: self._begin(choices, _Pace(request.speed, request.keep_going, request.ahead))

  def _on_prompt(self, request):
    return lambda: self._started() and self._change_prompt(request.prompt, request.after)

  def _on_restart(self, request):
    def restart():
      if self._started():
        self._begin(self._choices | {"prompt": request.prompt or self._choices["prompt"],
                                     "seed": self._choices["seed"] if request.seed is None else request.seed})

    return restart

  def _on_speed(self, request):
    return lambda: self._set_pace(speed=request.value)

  def _on_keep_going(self, request):
    return lambda: (self._set_pace(keep_going=request.on), self._send_state())

  def _set_pace(self, **changes):
    self._pace = self._pace._replace(**changes)

  def _on_ack(self, request):
    return lambda: setattr(self, "_acknowledged", max(self._acknowledged, min(request.sequence, self._sequence - 1)))

  def _on_control(self, request):
    control = list(request.control)
    stream_constraints.check(control)

    def constrain():
      if self._started():
        live = self._live.stream
        if control and self._live.skeleton is not HUMANML3D:
          raise InputError(f"got control of {self._live.skeleton.name}, a body of another skeleton; control knows the "
                           f"22 joints of {HUMANML3D.name}")
        first = self._set_constraints(control, request.at, live.num_frames)
        self._course = stream_constraints.Course.from_constraints(control, request.at, live.place)
        self._course_at = live.decided
        self._send({"type": "constrained", "run": self._run, "from_frame": first,
                    "until_frame": self._constrained_until})

    return constrain

  def _on_pause(self, request):
    return lambda: self._pause(True)

  def _on_resume(self, request):
    return lambda: self._pause(False)

  def _on_stop(self, request):
    def stop():
      self._live = None
      self._send_state("stopped")

    return stop

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
        self._wake.wait(0.02 if self._runs() and self._has_room() else 5.0)
      if self._closed:
        return False
      actions = list(self._inbox)
      self._inbox.clear()
    for action in actions:
      try:
        action()
      except ValueError as error:  # prompts or choices that the model does not accept
        self._send({"type": "error", "fatal": False, "message": reason(error, 400)})
    if self._may_step():
      self._step()
    return True

  def _runs(self):
    """Whether the clock runs: started, not paused, and not waiting for a prompt."""
    return self._live is not None and not self._paused and not self._waits()

  def _waits(self):
    return not self._pace.keep_going and self._sent >= self._end_of_prompt()

  def _end_of_prompt(self):
    """The frame at which the action of the last prompt ends, computed when it is first needed."""
    if self._ends is None:
      first, prompt = self._live.stream.script[-1]
      planner = self._live.pipeline.planner
      self._ends = first + planner.natural_frames(prompt, planner.plan(prompt).min_duration)
    return self._ends

  def _has_room(self):
    return self._sequence - 1 - self._acknowledged < self._pace.ahead

  def _may_step(self):
    now = time.monotonic()
    passed, self._checked_at = now - self._checked_at, now
    if not self._runs():
      return False
    # The page cannot play frames that have not arrived: after waiting for the sampler, the clock does not catch up.
    self._position = min(self._position + passed * self._pace.speed, self._sent / self._live.fps)
    lead = self._pace.ahead * self._live.block_seconds
    return self._has_room() and (not self._pace.speed or self._sent / self._live.fps < self._position + lead)

  def _started(self):
    if self._live is None:
      self._send({"type": "error", "fatal": False, "message": "there is no stream yet; start one with a start message"})
    return self._live is not None

  def _begin(self, choices, pace=None):
    """Starts a motion, at the present pace by default; if that fails, the previous motion continues."""
    pipeline = self._pipeline(choices["name"])
    if pipeline is None:
      return
    model = pipeline.model
    check_sampling(model, choices["sampling"])
    sampling = live_sampling(model, choices["sampling"])
    live = pipeline.stream(choices["prompt"], seed=choices["seed"], num_frames=choices["frames"],
                           cleanup=choices["cleanup"], without=choices["without"], **sampling)
    poses = choices["pose"] and Poses(choices["pose"], model.stats.layout.skeleton, model.fps)
    self._pace = pace or self._pace
    layout, self._choices = model.stats.layout.skeleton, choices
    self._run, self._sent, self._position, self._tail, self._paused = self._run + 1, 0, 0.0, None, False
    self._live = _Live(live, pipeline, layout, poses)
    self._send({"type": "started", "run": self._run, "sequence": self._sequence, "model": choices["name"],
                "id": model.id, "seed": choices["seed"], "cleanup": choices["cleanup"], "fps": model.fps,
                "joints": list(layout.joints), "parents": [int(parent) for parent in layout.parents],
                "block_frames": round(live.block_seconds * model.fps), "ahead": self._pace.ahead,
                "sampling": model.sampling(**sampling).about()} | ({"pose": poses.about} if poses else {}))
    self._prompts_before, self._constrained_until, self._course = self._prompts, 0, None
    self._announce_prompts(choices["prompt"], 0)
    self._sent_state = ""
    self._send_state()

  def _pipeline(self, name):
    """The pipeline of a model, once it is ready; None if the page has gone by then. Sends its loading progress."""
    slot, sent = self._library.slot(name), None
    while not slot.ready.wait(0.2):
      about = slot.progress()
      if (about["state"], about["doing"], int(about["seconds"])) != sent:
        sent = about["state"], about["doing"], int(about["seconds"])
        self._send({"type": "state"} | about)
      if self._closed:
        return None
    return self._library.pipeline(name, "stream")

  def _change_prompt(self, prompt, after):
    first = self._live.stream.say(prompt, after)
    self._choices["prompt"] = prompt
    self._announce_prompts(prompt, first)

  def _announce_prompts(self, prompt, first):
    """Sends a message for each action of a prompt that takes effect from frame `first` on."""
    pipeline, self._ends = self._live.pipeline, None
    captions = pipeline.model.captions
    actions = [(begins, action) for begins, action in self._live.stream.script if begins >= first]
    for begins, action in actions:
      self._prompts = self._number_of_prompt(begins)
      action = prompt if len(actions) == 1 else action
      warns = "warn" not in self._choices["without"]
      unknown = captions.unknown_words(action) if warns and captions.is_english(action) else []
      notes = pipeline.notes([action], postures=False) if warns else []
      self._send({"type": "words", "words": self._prompts, "prompt": action, "whole": prompt, "from_frame": begins,
                  "run": self._run, "unknown": unknown[:10],
                  "nearest": nearest_caption(pipeline, action) if unknown or notes else "", "notes": notes})
    self._send_state()

  def _number_of_prompt(self, frame):
    """The number of a frame's prompt, counted over all runs."""
    return self._prompts_before + self._live.stream.prompt_number(frame)

  def _pause(self, paused):
    if self._started():
      self._paused = paused
      self._send_state()

  def _send_state(self, state=None):
    if state is None and self._live is None:
      return
    state = state or ("paused" if self._paused else "waiting" if self._waits() else "running")
    if state != self._sent_state:
      self._sent_state = state
      self._send({"type": "state", "state": state, "run": self._run, "frames": self._sent})

  def _set_constraints(self, control, at=None, ends=None):
    """Constrains the stream from now on; returns the first frame that is still free."""
    live = self._live.stream
    signal = stream_constraints.signal_of(control, at, live.decided, live.place, ends, self._live.fps, self._limits)
    self._constrained_until = 0 if signal is None else signal.frames
    return live.hold(signal)

  def _update_constraints(self):
    """Before a step: continues a path without times from the body's place on it, and drops constraints of the past."""
    live = self._live.stream
    if self._course and live.decided != self._course_at:
      rest, self._course_at = self._course.rest(live.place), live.decided
      if rest is not None:
        self._set_constraints([rest])
        return
      self._course, self._constrained_until = None, live.decided
    if self._constrained_until and live.decided >= self._constrained_until:
      live.hold(None)  # unconstrained steps are faster
      self._constrained_until = 0

  def _step(self):
    began = time.perf_counter()
    live = self._live
    if live.ends is not None and self._sent >= live.ends:
      self._live = None
      self._send_state("ended")
      return
    self._update_constraints()
    joints = live.stream.step()
    live.spent += time.perf_counter() - began
    if not len(joints):
      return
    near = joints if self._tail is None else np.concatenate([self._tail, joints])
    stands = feet_stand(near, live.fps, live.skeleton, floor=0.0)[-len(joints):]
    self._tail = near[-_HISTORY:]
    number = self._number_of_prompt(self._sent)
    self._send(pack(Block(self._sequence, self._run, self._sent, number, live.stream.begun, 1000 * live.spent, live.fps,
                          joints, stands)))
    live.spent = 0.0
    if live.poses:
      first, ends = live.poses.count, live.ends is not None and self._sent + len(joints) >= live.ends
      if len(rows := live.poses.push(joints, ends)):
        self._send(pack_poses(rows, self._sequence, self._run, first, RATE))
    self._sequence, self._sent = self._sequence + 1, self._sent + len(joints)
    self._send_state()


class _Live:
  """A stream with its pipeline, its skeleton, its additional poses and its sampling time."""

  def __init__(self, stream, pipeline, skeleton, poses):
    self.poses = poses
    self.stream, self.pipeline, self.skeleton, self.spent = stream, pipeline, skeleton, 0.0
    self.fps = pipeline.model.fps
    self.block_seconds, self.ends = stream.block_seconds, stream.num_frames
