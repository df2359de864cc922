"""One live motion: a thread that samples while somebody watches, and does what the page says between two blocks."""
import collections
import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError, reason
from motion_studio.server import stream_constraints
from motion_studio.server.library import Library, live_sampling
from motion_studio.server.limits import Fields, Limits, told_plainly
from motion_studio.server.serialization import Block, pack

AHEAD = 3           # blocks that are sent before the page has acknowledged the first of them: 1.8 s
_BEHIND = 8         # frames before a block that its contacts are told by, too
_WAITING = 200      # messages of a page that wait while a model compiles or a block is sampled
_log = logging.getLogger("motion_studio.server")


class Stream:
  """A stream of one page: `tell` takes its messages, `send` gets what goes to it, from the stream's own thread.

  It samples only while fewer than `ahead` blocks wait to be acknowledged and none is more than these ahead of a clock
  that runs at `speed`: of a page that has stopped reading nothing piles up. An error ends this stream alone.
  """

  def __init__(self, library: Library, limits: Limits, send: Callable[[dict[str, Any] | bytes | None], None]) -> None:
    self._library, self._limits, self._send = library, limits, send
    self._wake = threading.Condition()
    self._inbox: collections.deque[Callable[[], None]] = collections.deque()
    self._closed = False
    self._acknowledged, self._sequence, self._run, self._words = -1, 0, 0, 0
    self._live: Any = None
    self._choices: dict[str, Any] = {}
    self._paused, self._keep_going, self._speed = False, True, 1.0
    self._ahead, self._sent, self._position, self._seen = AHEAD, 0, 0.0, time.monotonic()
    self._said: list[tuple[int, int]] = []  # (first frame, words) of the prompts of this run
    self._ends: int | None = None  # see `_until`
    self._held = 0  # frames up to which constraints reach
    self._course: stream_constraints.Course | None = None
    self._led = 0   # the first frame that was free when the course was last looked at
    self._tail, self._told = None, ""
    self._thread = threading.Thread(target=self._work, name="stream", daemon=True)
    self._thread.start()

  # --- from the page ---------------------------------------------------------------------------------------------

  def tell(self, message: Any) -> None:
    """A message of the page. Raises InputError for one that cannot be understood; nothing has changed then."""
    fields = Fields(message, self._limits)
    kind = fields.text("type")
    known = {"start": self._told_start, "prompt": self._told_prompt, "pause": self._told_pause,
             "resume": self._told_resume, "restart": self._told_restart, "speed": self._told_speed,
             "keep_going": self._told_keep_going, "ack": self._told_ack, "stop": self._told_stop,
             "control": self._told_control}
    if kind not in known:
      raise InputError(f"got a message of type {kind[:40]!r}, expected one of {', '.join(known)}")
    action = known[kind](fields)
    fields.done()
    with self._wake:
      if len(self._inbox) >= _WAITING:
        raise InputError(f"{_WAITING} messages wait to be done already; wait a moment")
      self._inbox.append(action)
      self._wake.notify()

  def close(self) -> None:
    """Ends the stream; what it is sampling just now is the last."""
    with self._wake:
      self._closed = True
      self._wake.notify()

  def join(self, seconds: float) -> bool:
    """Waits for the thread; whether it has ended."""
    self._thread.join(seconds)
    return not self._thread.is_alive()

  def _told_start(self, fields):
    choices = {"name": self._library.slot(fields.text("model", None)).name, "prompt": fields.prompt(),
               "seed": fields.seed(usual=None), "cleanup": fields.switch("cleanup", True),
               "sampling": fields.choices(),
               "frames": fields.number("frames", 4, self._limits.frames, None, whole=True)}
    speed, going = fields.number("speed", 0, 8, 1.0), fields.switch("keep_going", True)
    ahead = fields.number("ahead", 1, 32, AHEAD, whole=True)
    if choices["seed"] is None:
      choices["seed"] = secrets.randbelow(1 << 31)

    return lambda: self._begin(choices, _speed=speed, _keep_going=going, _ahead=ahead)

  def _told_prompt(self, fields):
    prompt, after = fields.prompt(), fields.number("after", 0, 3600, None)
    return lambda: self._started() and self._say(prompt, after)

  def _told_restart(self, fields):
    prompt, seed = fields.prompt(usual=None), fields.seed(usual=None)

    def restart():
      if self._started():
        self._begin(self._choices | {"prompt": prompt or self._choices["prompt"],
                                     "seed": self._choices["seed"] if seed is None else seed})

    return restart

  def _told_speed(self, fields):
    speed = fields.number("value", 0, 8)
    return lambda: setattr(self, "_speed", speed)

  def _told_keep_going(self, fields):
    going = fields.switch("on", True)
    return lambda: (setattr(self, "_keep_going", going), self._tell_state())

  def _told_ack(self, fields):
    sequence = fields.number("sequence", 0, 2**32 - 1, whole=True)
    return lambda: setattr(self, "_acknowledged", max(self._acknowledged, min(sequence, self._sequence - 1)))

  def _told_control(self, fields):
    at, control = fields.number("at", 0, 1e6, None), fields.control()
    stream_constraints.check(control)

    def hold():
      if self._started():
        live = self._live.stream
        if control and self._live.skeleton is not HUMANML3D:
          raise InputError(f"got control of {self._live.skeleton.name}, a body of another skeleton; control knows the "
                           f"22 joints of {HUMANML3D.name}")
        first = self._hold(control, at, live.num_frames)
        self._course, self._led = stream_constraints.Course.from_constraints(control, at, live.place), live.decided
        self._send({"type": "held", "run": self._run, "from_frame": first, "until_frame": self._held})

    return hold

  def _told_pause(self, fields):
    return lambda: self._pause(True)

  def _told_resume(self, fields):
    return lambda: self._pause(False)

  def _told_stop(self, fields):
    def stop():
      self._live = None
      self._tell_state("stopped")

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
                  f"this stream met a fault of the program ({type(error).__name__}); the others go on, start it again"})
    finally:
      self._live = None
      self._send(None)

  def _turn(self) -> bool:
    """Does what the page said, then a step if there is room for one; False once the page has gone."""
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
      except ValueError as error:  # words that the model refuses, choices that it does not have
        self._send({"type": "error", "fatal": False, "message": reason(error, 400)})
    if self._may_step():
      self._step()
    return True

  def _runs(self):
    """Whether the clock runs. Where the words have been done and nothing is to go on, it waits."""
    return self._live is not None and not self._paused and not self._waits()

  def _waits(self):
    return not self._keep_going and self._sent >= self._until()

  def _until(self):
    """The frame with which the words that were said last have been done; found out once somebody asks."""
    if self._ends is None:
      first, prompt = self._live.stream.script[-1]
      self._ends = first + self._live.model.natural_frames(prompt)
    return self._ends

  def _has_room(self):
    return self._sequence - 1 - self._acknowledged < self._ahead

  def _may_step(self):
    now = time.monotonic()
    passed, self._seen = now - self._seen, now
    if not self._runs():
      return False
    # Nobody plays what has not come: a clock that waited for the sampler does not hurry it afterwards.
    self._position = min(self._position + passed * self._speed, self._sent / self._live.fps)
    lead = self._ahead * self._live.block_seconds
    return self._has_room() and (not self._speed or self._sent / self._live.fps < self._position + lead)

  def _started(self):
    if self._live is None:
      self._send({"type": "error", "fatal": False, "message": "there is no stream yet; begin one with a start message"})
    return self._live is not None

  def _begin(self, choices, **settings):
    """Another motion, and attributes of this stream that change with it; where it cannot be, the older one goes on."""
    model = self._model(choices["name"])
    if model is None:
      return
    sampling = live_sampling(model, choices["sampling"])
    with told_plainly():
      live = model.stream(choices["prompt"], seed=choices["seed"], num_frames=choices["frames"],
                          cleanup=choices["cleanup"], **sampling)
    for name, value in settings.items():
      setattr(self, name, value)
    layout, self._choices = model.stats.layout.skeleton, choices
    self._run, self._sent, self._position, self._tail, self._paused = self._run + 1, 0, 0.0, None, False
    self._live = _Live(live, model, layout)
    self._send({"type": "started", "run": self._run, "sequence": self._sequence, "model": choices["name"],
                "id": model.id, "seed": choices["seed"], "cleanup": choices["cleanup"], "fps": model.fps,
                "joints": list(layout.joints), "parents": [int(parent) for parent in layout.parents],
                "block_frames": round(live.block_seconds * model.fps), "ahead": self._ahead,
                "sampling": model.sampling(**sampling).about()})
    self._said, self._held, self._course = [], 0, None
    self._note_words(choices["prompt"], 0)
    self._told = ""
    self._tell_state()

  def _model(self, name):
    """The model, once it is ready; None where the page has gone before."""
    slot, told = self._library.slot(name), None
    while not slot.ready.wait(0.2):
      about = slot.progress()
      if (about["state"], about["doing"], int(about["seconds"])) != told:
        told = about["state"], about["doing"], int(about["seconds"])
        self._send({"type": "state"} | about)
      if self._closed:
        return None
    return self._library.model(name, "stream")

  def _say(self, prompt, after):
    first = self._live.stream.say(prompt, after)
    self._choices["prompt"] = prompt
    self._note_words(prompt, first)

  def _note_words(self, prompt, first):
    """A message for each action of a prompt that counts from a frame on."""
    model, self._ends = self._live.model, None
    actions = [(begins, said) for begins, said in self._live.stream.script if begins >= first]
    self._said = [(frame, words) for frame, words in self._said if frame < first]
    for begins, said in actions:
      self._words += 1
      self._said.append((begins, self._words))
      said = prompt if len(actions) == 1 else said
      unknown = model.unknown_words(said)
      nearest = model.nearest_captions(said)[:1] if unknown else []
      self._send({"type": "words", "words": self._words, "prompt": said, "whole": prompt, "from_frame": begins,
                  "run": self._run, "unknown": unknown[:10], "nearest": nearest[0][0] if nearest else "",
                  "notes": model.notes_of([said])})
    self._tell_state()

  def _pause(self, paused):
    if self._started():
      self._paused = paused
      self._tell_state()

  def _tell_state(self, state=None):
    if state is None and self._live is None:
      return
    state = state or ("paused" if self._paused else "waiting" if self._waits() else "running")
    if state != self._told:
      self._told = state
      self._send({"type": "state", "state": state, "run": self._run, "frames": self._sent})

  def _hold(self, control, at=None, ends=None):
    """Leads the stream by constraints from now on: the first frame that is still free."""
    live = self._live.stream
    held = stream_constraints.signal_of(control, at, live.decided, live.place, ends, self._live.fps, self._limits)
    self._held = 0 if held is None else held.frames
    return live.hold(held)

  def _lead(self):
    """Before a step: a path without times goes on from where the body has come on it, and what is past lets go."""
    live = self._live.stream
    if self._course and live.decided != self._led:
      rest, self._led = self._course.rest(live.place), live.decided
      if rest is not None:
        self._hold([rest])
        return
      self._course, self._held = None, live.decided
    if self._held and live.decided >= self._held:
      live.hold(None)  # free steps take less time
      self._held = 0

  def _step(self):
    began = time.perf_counter()
    live = self._live
    if live.ends is not None and self._sent >= live.ends:
      self._live = None
      self._tell_state("ended")
      return
    self._lead()
    joints = live.stream.step()
    live.spent += time.perf_counter() - began
    if not len(joints):
      return
    near = joints if self._tail is None else np.concatenate([self._tail, joints])
    stands = feet_stand(near, live.fps, live.skeleton, floor=0.0)[-len(joints):]
    self._tail = near[-_BEHIND:]
    words = [words for frame, words in self._said if frame <= self._sent][-1]
    while len(self._said) > 1 and self._said[1][0] <= self._sent:
      del self._said[0]
    self._send(pack(Block(self._sequence, self._run, self._sent, words, live.stream.begun, 1000 * live.spent, live.fps,
                          joints, stands)))
    live.spent = 0.0
    self._sequence, self._sent = self._sequence + 1, self._sent + len(joints)
    self._tell_state()


class _Live:
  """A model's stream with what is asked of it again and again."""

  def __init__(self, stream, model, skeleton):
    self.stream, self.model, self.skeleton, self.fps, self.spent = stream, model, skeleton, model.fps, 0.0
    self.block_seconds, self.ends = stream.block_seconds, stream.num_frames
