"""A client of `motion-jax studio`: motion on request and live. It needs only numpy and websockets.

  studio = Client("http://127.0.0.1:8765/?token=...")     # the address that the studio printed
  motion = studio.generate("a person waves", seconds=4)[0]
  open("wave.glb", "wb").write(studio.export(motion, "glb"))
  with studio.stream("a person walks") as live:
    for frames in live:                                   # (n, 22, 3) metres
      live.say("a person jumps")
"""
import base64
import json
import struct
import urllib.error
import urllib.parse
import urllib.request

import numpy as np


class Client:
  """The requests of docs/protocol.md. Raises ValueError with the studio's sentence if it refuses one."""

  def __init__(self, address):
    parts = urllib.parse.urlsplit(address)
    self.base, self.token = f"http://{parts.netloc}", urllib.parse.parse_qs(parts.query).get("token", [""])[0]

  def request(self, path, body=None):
    data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
    call = urllib.request.Request(self.base + path, data, {"authorization": f"Bearer {self.token}"})
    try:
      with urllib.request.urlopen(call) as reply:
        return reply.read()
    except urllib.error.HTTPError as error:
      raise ValueError(json.loads(error.read())["error"]["message"]) from None

  def models(self):
    return json.loads(self.request("/v1/models"))["models"]

  def generate(self, prompt, **fields):
    return json.loads(self.request("/v1/generate", {"prompt": prompt, **fields}))["motions"]

  def multi_prompt(self, segments, **fields):
    rows = [{"prompt": prompt, "seconds": seconds} for prompt, seconds in segments]
    return json.loads(self.request("/v1/multi-prompt", {"segments": rows, **fields}))

  def edit(self, motion, prompt, **fields):
    return json.loads(self.request("/v1/edit", {"motion": motion, "prompt": prompt, **fields}))["motion"]

  def export(self, motion, format, **fields):
    return self.request("/v1/export", {"motion": motion, "format": format, **fields})

  def stream(self, prompt, **fields):
    return Live(f"{self.base.replace('http', 'ws', 1)}/v1/stream?token={urllib.parse.quote(self.token)}",
                {"type": "start", "prompt": prompt, **fields})


def joints_of(motion):
  """Joints (T, J, 3) float32 of a motion that the studio returned."""
  return np.frombuffer(base64.b64decode(motion["joints"]), "<f4").reshape(motion["shape"])


class Live:
  """Yields joints (n, J, 3) block by block; `last` is the header of the latest block, `messages` the other messages."""

  def __init__(self, address, start):
    from websockets.sync.client import connect
    self._open = connect(address, max_size=None)
    self._socket, self.last, self.messages = self._open.__enter__(), {}, []
    self.send(**start)

  def send(self, **message):
    self._socket.send(json.dumps(message))

  def say(self, prompt, **fields):
    self.send(type="prompt", prompt=prompt, **fields)

  def __iter__(self):
    from websockets.exceptions import ConnectionClosed
    try:
      for message in self._socket:
        if isinstance(message, str):
          self.messages.append(json.loads(message))
          if self.messages[-1]["type"] == "error":
            raise ValueError(self.messages[-1]["message"])
          if self.messages[-1].get("state") in ("ended", "stopped"):
            return
          continue
        names = "sequence run first_frame frames joints words committed begun milliseconds fps".split()
        size, *values = struct.unpack_from("<6xHIIIHHIIIff", message)
        self.last = dict(zip(names, values))
        n, count = self.last["frames"], self.last["joints"]
        ground = np.frombuffer(message, "<f4", n * 2, size).reshape(n, 1, 2)
        joints = np.frombuffer(message, "<f2", n * count * 3, size + 8 * n).reshape(n, count, 3).astype(np.float32)
        joints[..., [0, 2]] += ground
        self.last["contacts"] = np.frombuffer(message, "u1", 4 * n, size + n * (8 + 6 * count)).reshape(n, 4) > 0
        self.send(type="ack", sequence=self.last["sequence"])
        yield joints
    except ConnectionClosed:
      return

  def close(self):
    self._open.__exit__(None, None, None)

  def __enter__(self):
    return self

  def __exit__(self, *_):
    self.close()
