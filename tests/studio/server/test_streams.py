"""One WebSocket, one motion: every message, what it changes, and what a page that misbehaves gets."""
import asyncio
import contextlib
import dataclasses
import json
import threading
import time

import numpy as np
import pytest
from starlette.websockets import WebSocketDisconnect

from motion_jax.utils.errors import InputError
from motion_jax_studio.server import app, serialization, streams
from motion_jax_studio.server.limits import Limits
from tests.studio.server.conftest import SOCKET, TOKEN

URL = f"{SOCKET}/v1/stream?token={TOKEN}"


class Page:
  """What a page keeps of a stream: headers and joints of its blocks, and the other messages."""

  def __init__(self, socket):
    self.socket, self.blocks, self.told = socket, [], []

  def send(self, **message):
    self.socket.send_text(json.dumps(message))

  def next(self, ack=True):
    """The next message: a header with joints, or JSON."""
    message = self.socket.receive()
    if message["type"] == "websocket.close":
      raise WebSocketDisconnect(message["code"], message.get("reason", ""))
    if message.get("bytes") is None:
      self.told.append(json.loads(message["text"]))
      return self.told[-1]
    self.blocks.append(unpacked(message["bytes"]))
    if ack:
      self.send(type="ack", sequence=self.blocks[-1]["sequence"])
    return self.blocks[-1]

  def until(self, ack=True, **wanted):
    """The next message with these values."""
    while True:
      message = self.next(ack)
      if all(message.get(key) == value for key, value in wanted.items()):
        return message

  def more(self, count, ack=True):
    """So many blocks more."""
    found = []
    while len(found) < count:
      message = self.next(ack)
      found += ["positions" in message and message] if "positions" in message else []
    return found

  def joints(self, run=None):
    return np.concatenate([block["positions"] for block in self.blocks if run in (None, block["run"])])


def unpacked(data):
  """A block, read as docs/protocol.md says it is written."""
  number = lambda at, size: int.from_bytes(data[at:at + size], "little")
  assert data[:4] == b"MJXS" and number(4, 2) == 1
  head, n, count = number(6, 2), number(20, 2), number(22, 2)
  assert len(data) == head + n * (8 + 6 * count + 4)
  names = {"sequence": 8, "run": 12, "first_frame": 16, "words": 24, "committed": 28, "begun": 32}
  ground = np.frombuffer(data, "<f4", 2 * n, head).reshape(n, 1, 2)
  joints = np.frombuffer(data, "<f2", 3 * n * count, head + 8 * n).reshape(n, count, 3).astype(np.float32)
  joints[..., [0, 2]] += ground
  return {name: number(at, 4) for name, at in names.items()} | {
      "milliseconds": np.frombuffer(data, "<f4", 1, 36)[0], "fps": np.frombuffer(data, "<f4", 1, 40)[0],
      "positions": joints, "contacts": np.frombuffer(data, "u1", 4 * n, head + n * (8 + 6 * count)).reshape(n, 4)}


@pytest.fixture
def page(client):
  with client.websocket_connect(URL) as socket:
    yield Page(socket)


def test_a_block_is_exact_wherever_the_body_is():
  joints = np.random.default_rng(0).uniform(-1, 1, (12, 22, 3)).astype(np.float32) + [5000, 1, -3000]
  data = serialization.pack(serialization.Block(7, 2, 40, 3, 64, 12.5, 20.0, joints, np.eye(12, 4) > 0))
  block = unpacked(data)
  assert len(data) == 1776
  assert np.abs(block["positions"] - joints).max() < 1.5e-3
  numbers = [block[key] for key in ("sequence", "run", "first_frame", "words", "committed", "begun")]
  assert numbers == [7, 2, 40, 3, 52, 64]
  assert (block["milliseconds"], block["fps"]) == (12.5, 20.0) and (block["contacts"] == np.eye(12, 4)).all()


def test_a_stream_is_the_models_stream(page, library):
  """Frames follow one another, are those of `model.stream`, and the end comes where it was asked."""
  page.send(type="start", prompt="a person walks", seed=3, speed=0, frames=100, ahead=2)
  page.until(type="state", state="ended")
  started = next(message for message in page.told if message["type"] == "started")
  assert [block["sequence"] for block in page.blocks] == list(range(len(page.blocks)))
  starts = np.cumsum([0] + [len(block["positions"]) for block in page.blocks])
  assert [block["first_frame"] for block in page.blocks] == starts[:-1].tolist() and starts[-1] == 100
  assert [block["committed"] for block in page.blocks] == starts[1:].tolist()
  assert started["seed"] == 3 and started["run"] == 1 and len(started["joints"]) == len(started["parents"]) == 22
  live = library.pipeline("tiny", "stream").stream("a person walks", seed=3, num_frames=100,
                                                    lag=started["sampling"]["lag"])
  made = np.concatenate(list(live))
  assert np.abs(page.joints() - made).max() < 2e-3


def test_other_words_change_what_has_not_begun_and_nothing_before(page):
  say = lambda first: (page.send(type="start", prompt="a person walks", seed=4, speed=0, ahead=1), page.more(first))
  say(6)
  page.send(type="stop")
  page.until(type="state", state="stopped")
  page.blocks.clear()
  page.send(type="start", prompt="a person walks", seed=4, speed=0, ahead=1)
  page.more(2)
  page.send(type="prompt", prompt="a person jumps")
  words = page.until(type="words", prompt="a person jumps")
  border = words["from_frame"]
  page.more(6)
  page.send(type="restart", prompt="a person walks")
  page.until(type="started", run=3)
  page.more(8)
  changed, plain = page.joints(2), page.joints(3)
  border_given = border - 10  # the cleanup looks so far ahead
  assert 24 <= border <= 60
  assert (changed[:border_given] == plain[:border_given]).all()
  assert not (changed[border:border + 20] == plain[border:border + 20]).all()
  made_of = {block["first_frame"]: block["words"] for block in page.blocks if block["run"] == 2}
  assert all((number == words["words"]) == (first >= border) for first, number in made_of.items())


def test_the_actions_of_a_prompt_count_one_after_the_other(page):
  page.send(type="start", prompt="a person walks, then waves", seed=4, speed=0, ahead=4)
  first = page.until(type="words", prompt="a person walks")
  second = page.until(type="words", prompt="a person waves")
  assert first["whole"] == second["whole"] == "a person walks, then waves" and first["from_frame"] == 0
  while not page.blocks or page.blocks[-1]["first_frame"] < second["from_frame"] + 24:
    page.next()
  for block in page.blocks:
    assert block["words"] == (first if block["first_frame"] < second["from_frame"] else second)["words"]
  page.send(type="keep_going", on=False)  # waits once the last action is done
  page.until(type="state", state="waiting")
  page.send(type="restart")
  assert page.until(type="started", run=2) and page.until(type="words", prompt="a person waves", run=2)


def test_steps_of_a_stream_are_left_out_by_name(page):
  page.send(type="start", prompt="a person walks, then zorbles", seed=4, speed=0, ahead=1, without=["plan", "warn"])
  words = page.until(type="words")
  assert words["prompt"] == words["whole"] and not words["notes"] and not words["unknown"] and not words["nearest"]
  page.send(type="prompt", prompt="a person zorbles, then waves")
  words = page.until(type="words")
  assert words["prompt"] == words["whole"] and not words["notes"]
  page.send(type="start", prompt="a person walks", without=["pose"])
  assert "'pose' in without, expected" in page.until(type="error")["message"]


def test_a_page_that_does_not_read_stops_the_sampling(page, studio):
  page.send(type="start", prompt="a person walks", seed=1, speed=0, ahead=3)
  page.more(3, ack=False)
  stream = next(iter(studio.streams))
  time.sleep(0.3)
  assert stream._sequence == 3
  page.send(type="ack", sequence=0)
  page.more(1, ack=False)
  page.send(type="ack", sequence=10**6)  # of blocks that were never sent
  page.more(3, ack=False)
  page.send(type="restart")
  assert page.until(ack=False, type="started", run=2)["sequence"] == 7


def test_the_clock_holds_the_sampling_back(page, studio):
  """At the usual speed no more is sampled than `ahead` blocks before what could have been played."""
  page.send(type="start", prompt="a person walks", seed=1, ahead=2)
  page.more(2)
  stream, began = next(iter(studio.streams)), time.monotonic()
  page.more(3)
  seconds = stream._live.stream.block_seconds
  assert time.monotonic() - began > 0.5 * seconds
  page.send(type="speed", value=0)
  began = time.monotonic()
  page.more(8)
  assert time.monotonic() - began < 6 * seconds


def test_pause_resume_and_stop(page, studio):
  page.send(type="start", prompt="a person walks", seed=1, speed=0)
  page.more(2)
  page.send(type="pause")
  page.until(type="state", state="paused")
  stream = next(iter(studio.streams))
  count = stream._sequence
  time.sleep(0.2)
  assert stream._sequence == count
  page.send(type="resume")
  page.until(type="state", state="running")
  page.more(1)
  page.send(type="stop")
  page.until(type="state", state="stopped")
  page.send(type="prompt", prompt="a person jumps")
  assert "no stream yet" in page.until(type="error")["message"]


def test_without_keep_going_a_stream_waits_for_words(page, library, monkeypatch):
  monkeypatch.setattr(library.pipeline("tiny", "stream").planner, "natural_frames", lambda *_: 48)
  page.send(type="start", prompt="a person walks", seed=1, speed=0, keep_going=False)
  told = page.until(type="state", state="waiting")
  assert 48 <= told["frames"] < 48 + 24
  page.send(type="prompt", prompt="a person jumps")
  page.until(type="state", state="running")
  page.until(type="state", state="waiting")
  page.send(type="keep_going", on=True)
  page.until(type="state", state="running")
  page.more(6)


@pytest.mark.parametrize("message, told", [
    ({}, "type is missing"), ([], "got a list, expected a JSON object"), ({"type": "jump"}, "expected one of start"),
    ({"type": "start", "prompt": "a", "model": "../secret"}, "this studio has tiny, editor"),
    ({"type": "start", "prompt": "a", "sampling": {"schedule": "full"}}, "schedule"),
    ({"type": "start", "prompt": "a", "model": "editor"}, "has no 'stream'; tiny has"),
    ({"type": "prompt", "prompt": "a"}, "no stream yet"), ("{", "got no valid JSON (")])
def test_what_cannot_be_gets_one_sentence_and_the_stream_lives(page, message, told):
  page.socket.send_text(message if isinstance(message, str) else json.dumps(message))
  error = page.until(type="error")
  assert told in error["message"] and not error["fatal"] and "\n" not in error["message"]
  page.send(type="start", prompt="a person walks 🙂", seed=1, speed=0)
  page.more(1)


def test_choices_that_cannot_be_leave_the_motion_that_runs(page):
  page.send(type="start", prompt="a person walks", seed=1, speed=0, ahead=2)
  page.more(2)
  for name, value in (("bogus", 1), ("num_steps", "x"), ("guidance_scale", True), ("lag", 1.5)):
    page.send(type="start", prompt="a person jumps", seed=2, speed=1, sampling={name: value})
    assert name in page.until(type="error", fatal=False)["message"]
  page.more(4)
  page.send(type="restart")
  page.until(type="started", run=2, seed=1, ahead=2)


def test_messages_that_wait_are_bounded():
  from motion_jax_studio.server.library import Library
  stream = streams.Stream(Library(["never"]), Limits(), lambda message: None)  # whose model is never ready
  try:
    stream.receive({"type": "start", "prompt": "a person walks"})
    with pytest.raises(InputError, match="200 messages wait"):
      for _ in range(500):  # the thread takes at most 201 of them before it waits for the model
        stream.receive({"type": "pause"})
    assert len(stream._inbox) <= 200
  finally:
    stream.close()
    assert stream.join(10)


def test_a_page_that_asks_and_never_reads_is_let_go(client, studio, monkeypatch):
  async def full(socket, outbox):
    await asyncio.sleep(60)

  begun = []
  monkeypatch.setattr(app, "_deliver", full)
  studio.limits = dataclasses.replace(studio.limits, unsent=4)
  monkeypatch.setattr(app, "Stream", lambda *given: begun.append(streams.Stream(*given)) or begun[-1])
  with client.websocket_connect(URL) as socket:
    page = Page(socket)
    page.send(type="start", prompt="a person walks", seed=1, speed=0)
    for _ in range(4):
      page.send(type="prompt", prompt="a person jumps")
    while not begun:  # the program takes a moment, and lets go soon
      time.sleep(0.01)
    assert begun[0].join(20)
  assert not studio.streams and studio.places == 0


@pytest.mark.parametrize("send, code", [
    (lambda page: page.socket.send_bytes(b"MJXS"), 1003),
    (lambda page: page.socket.send_text("x" * (Limits().message_bytes + 1)), 1009),
    (lambda page: [page.send(type="ack", sequence=0) for _ in range(200)], 1008)])
def test_a_page_that_says_too_much_is_cut_off(page, send, code):
  with contextlib.suppress(WebSocketDisconnect, RuntimeError):
    send(page)
  with pytest.raises(WebSocketDisconnect) as closed:
    page.until(type="nothing")
  assert closed.value.code == code and page.told[-1]["fatal"]


def test_streams_are_counted(client, studio, monkeypatch):
  monkeypatch.setattr(studio, "limits", Limits(streams=2))
  with client.websocket_connect(URL), client.websocket_connect(URL), client.websocket_connect(URL) as third:
    assert "2 streams run already" in json.loads(third.receive_text())["message"]
    with pytest.raises(WebSocketDisconnect) as closed:
      third.receive_text()
    assert closed.value.code == 1013
  deadline = time.monotonic() + 10
  while studio.streams or studio.places:  # a stream ends with its page
    assert time.monotonic() < deadline
    time.sleep(0.01)


def test_a_crash_in_one_stream_leaves_the_others(client, monkeypatch):
  monkeypatch.setattr(streams._log, "disabled", True)
  with client.websocket_connect(URL) as one, client.websocket_connect(URL) as two:
    first, second = Page(one), Page(two)
    for page in (first, second):
      page.send(type="start", prompt="a person walks", seed=1, speed=0)
      page.more(1)
    spoiled = streams.feet_stand
    victim = threading.Event()

    def broken(*arguments, **named):
      if not victim.is_set():
        victim.set()
        raise KeyError("/secret/path")
      return spoiled(*arguments, **named)

    second.send(type="pause")
    second.until(type="state", state="paused")
    monkeypatch.setattr(streams, "feet_stand", broken)
    with pytest.raises(WebSocketDisconnect):
      first.until(type="nothing")
    assert "fault of the program (KeyError)" in first.told[-1]["message"] and "secret" not in first.told[-1]["message"]
    second.send(type="resume")
    second.more(5)


@pytest.mark.slow
def test_a_model_that_follows_prompts_alone_is_ready_to_stream(random_run):
  """What is compiled in advance draws no path for it."""
  from motion_jax_studio.server.library import Library
  library = Library([str(random_run("dip"))])
  library.start().join(300)
  slot = library.slot(None)
  assert (slot.state, slot.error) == ("ready", "")
